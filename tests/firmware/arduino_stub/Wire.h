// A stub of the library Wire of ArduinoCore-sam. Like the real library, it ignores whether a STOP is
// requested.
#pragma once

#include "Arduino.h"

#define BUFFER_LENGTH 32
#define WIRE_HAS_END 1

class TwoWire : public Stream {
  public:
    void begin();
    void begin(uint8_t);
    void begin(int);
    void end();
    void setClock(uint32_t);
    void beginTransmission(uint8_t);
    void beginTransmission(int);
    uint8_t endTransmission(void);
    uint8_t endTransmission(uint8_t);
    uint8_t requestFrom(uint8_t, uint8_t);
    uint8_t requestFrom(uint8_t, uint8_t, uint8_t);
    uint8_t requestFrom(uint8_t, uint8_t, uint32_t, uint8_t, uint8_t);
    uint8_t requestFrom(int, int);
    uint8_t requestFrom(int, int, int);
    size_t write(uint8_t) override;
    size_t write(const uint8_t*, size_t) override;
    int available(void) override;
    int read(void) override;
    int peek(void) override;
    void flush(void) override;

    inline size_t write(unsigned long n) { return write((uint8_t)n); }
    inline size_t write(long n) { return write((uint8_t)n); }
    inline size_t write(unsigned int n) { return write((uint8_t)n); }
    inline size_t write(int n) { return write((uint8_t)n); }

  private:
    uint8_t rx_[BUFFER_LENGTH];
    uint8_t rx_index_ = 0;
    uint8_t rx_length_ = 0;
    uint8_t tx_[BUFFER_LENGTH];
    uint8_t tx_length_ = 0;
    uint8_t tx_address_ = 0;
};

extern TwoWire Wire;
