// Creates numpy arrays one after another in the memory of a bytearray. The arrays keep the bytearray alive.
// Creating such an array takes a seventh of a microsecond. Creating an array of nanobind's own class takes
// twice as long.
#pragma once

#include <nanobind/nanobind.h>

#include <cstddef>
#include <cstdint>

class Numpy {
  public:
    // The module numpy is looked up once and never released. Looking it up for each table would take longer
    // than creating the few arrays of the table.
    static const Numpy& loaded() {
        static const Numpy* const one = new Numpy;
        return *one;
    }
    nanobind::object of(const double*) const { return float64; }
    nanobind::object of(const std::int64_t*) const { return int64; }
    nanobind::object of(const std::int16_t*) const { return int16; }
    nanobind::object of(const std::uint8_t*) const { return bools; }

    nanobind::object ndarray;

  private:
    Numpy() {
        const nanobind::module_ numpy = nanobind::module_::import_("numpy");
        ndarray = numpy.attr("ndarray");
        const auto dtype = [&numpy](const char* name) { return numpy.attr("dtype")(name); };
        int64 = dtype("int64");
        int16 = dtype("int16");
        float64 = dtype("float64");
        bools = dtype("bool");
    }
    nanobind::object int64, int16, float64, bools;
};

class NumpyTable {
  public:
    explicit NumpyTable(std::size_t bytes)
        : buffer_(nanobind::steal(PyByteArray_FromStringAndSize(nullptr, static_cast<Py_ssize_t>(bytes)))) {
        if (!buffer_.is_valid()) nanobind::raise_python_error();
        next_ = PyByteArray_AsString(buffer_.ptr());
    }

    // Returns memory for `count` numbers of the type T. The caller has to ask for wider types first, so that
    // all numbers are aligned.
    template <typename T>
    T* room(std::size_t count) {
        T* const found = reinterpret_cast<T*>(next_);
        next_ += count * sizeof(T);
        return found;
    }

    template <typename T>
    nanobind::object array(const T* at, const nanobind::tuple& shape) const {
        const std::ptrdiff_t offset = reinterpret_cast<const char*>(at) - PyByteArray_AsString(buffer_.ptr());
        return Numpy::loaded().ndarray(shape, Numpy::loaded().of(at), buffer_, offset);
    }

  private:
    nanobind::object buffer_;
    char* next_ = nullptr;
};
