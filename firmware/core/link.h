// Sends frames to the host. A frame is sent completely or not at all, and nothing waits for the serial port.
// Room for samples is always kept free.
#pragma once

#include <stddef.h>
#include <stdint.h>

#include "byte_sink.h"
#include "frame.h"
#include "messages.h"
#include "settings.h"

namespace fltea {

class Link {
  public:
    explicit Link(ByteSink& sink) : sink_(sink) {}

    // Sends the sample, or drops it and counts the drop. The sequence number counts as used in both cases.
    void send_sample(const Sample& sample, uint16_t sequence, uint32_t device_us) {
        if (room_for<Sample>(0)) {
            write(sample, sequence, device_us);
        } else {
            ++dropped_frames_;
        }
    }

    // Sends a message that is not a sample, if the ring buffer then still has room for a sample. Otherwise
    // returns false, and the caller has to try again later. `quiet_us`: time until the next sample comes at
    // the earliest. The bytes that the serial port can send in this time count as room, because a small ring
    // buffer cannot hold a message and a sample at once.
    template <typename Message>
    bool send(const Message& message, uint32_t device_us, uint32_t quiet_us = 0) {
        const size_t gone = quiet_us / kByteUs;  // bytes that the serial port sends during quiet_us
        if (!room_for<Message>(gone < wire_size<Sample>() ? wire_size<Sample>() - gone : 0)) return false;
        write(message, sequences_[Message::type()]++, device_us);
        return true;
    }

    uint32_t dropped_frames() const { return dropped_frames_; }

  private:
    template <typename Message>
    bool room_for(size_t spare) {
        return sink_.room() >= (opened_ ? 0 : kOpening) + wire_size<Message>() + spare;
    }

    template <typename Message>
    void write(const Message& message, uint16_t sequence, uint32_t device_us) {
        uint8_t wire[kOpening + wire_size<Message>()];
        wire[0] = 0;
        const size_t n = encode_message(message, sequence, device_us, wire + kOpening);
        if (opened_) {
            sink_.write(wire + kOpening, n);
        } else {
            sink_.write(wire, kOpening + n);
            opened_ = true;
        }
    }

    // Time that a byte takes on the serial port, where it has ten bits.
    static constexpr uint32_t kByteUs = 10 * 1000000 / settings::kLineBaud;

    // A 0x00 before the first frame ends any earlier incomplete data on the serial port.
    static constexpr size_t kOpening = 1;

    ByteSink& sink_;
    uint32_t dropped_frames_ = 0;
    uint16_t sequences_[Spectrum::type() + 1] = {};
    bool opened_ = false;
};

}  // namespace fltea
