// Gives access to the bytes of a Python bytes-like object. The object stays alive as long as this view
// exists.
#pragma once

#include <nanobind/nanobind.h>

#include <cstddef>
#include <cstdint>

class BufferView {
  public:
    // Raises TypeError if `object` is not bytes-like, BufferError if its bytes are not contiguous.
    explicit BufferView(nanobind::handle object) {
        if (PyObject_GetBuffer(object.ptr(), &view_, PyBUF_SIMPLE) != 0) nanobind::raise_python_error();
    }
    ~BufferView() { PyBuffer_Release(&view_); }
    BufferView(const BufferView&) = delete;
    BufferView& operator=(const BufferView&) = delete;

    const std::uint8_t* data() const { return static_cast<const std::uint8_t*>(view_.buf); }
    std::size_t size() const { return static_cast<std::size_t>(view_.len); }

  private:
    Py_buffer view_;
};
