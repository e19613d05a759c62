// The part of the Arduino SAM core that the sketch uses, with the signatures and macros of ArduinoCore-sam
// 1.6 (cores/arduino: Arduino.h, wiring*.h, WInterrupts.h, watchdog.h, Print.h, UARTClass.h;
// variants/arduino_due_x: variant.h). The bodies are in board.cpp and act on stub::board.
#pragma once

#include <math.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#include "chip.h"

#define HIGH 0x1
#define LOW 0x0
#define INPUT 0x0
#define OUTPUT 0x1
#define INPUT_PULLUP 0x2
#define CHANGE 2
#define FALLING 3
#define RISING 4
#define DEFAULT 1
#define EXTERNAL 0
#define SERIAL 0x0
#define DISPLAY 0x1
#define PI 3.1415926535897932384626433832795
#define EULER 2.718281828459045235360287471352
#define DEC 10
#define HEX 16
#define OCT 8
#define BIN 2

// Macros of the Arduino core. No program that includes this file can use their names for anything else.
#undef abs
#define abs(x) ((x) > 0 ? (x) : -(x))
#define min(a, b) ((a) < (b) ? (a) : (b))
#define max(a, b) ((a) > (b) ? (a) : (b))
#define round(x) ((x) >= 0 ? (long)((x) + 0.5) : (long)((x) - 0.5))
#define constrain(amt, low, high) ((amt) < (low) ? (low) : ((amt) > (high) ? (high) : (amt)))
#define radians(deg) ((deg) * 0.017453292519943295)
#define degrees(rad) ((rad) * 57.29577951308232)
#define sq(x) ((x) * (x))
#define bit(b) (1UL << (b))
#define interrupts() __enable_irq()
#define noInterrupts() __disable_irq()
typedef unsigned int word;
typedef uint8_t boolean;
typedef uint8_t byte;

#define VARIANT_MCK 84000000
#define PIN_WIRE_SDA (20u)
#define PIN_WIRE_SCL (21u)
#define WIRE_INTERFACE TWI1
#define LED_BUILTIN 13
static const uint8_t SDA __attribute__((unused)) = PIN_WIRE_SDA;
static const uint8_t SCL __attribute__((unused)) = PIN_WIRE_SCL;

extern "C" {
uint32_t millis(void);
uint32_t micros(void);
void delayMicroseconds(uint32_t usec);
void pinMode(uint32_t ulPin, uint32_t ulMode);
void digitalWrite(uint32_t ulPin, uint32_t ulVal);
int digitalRead(uint32_t ulPin);
void attachInterrupt(uint32_t pin, void (*callback)(void), uint32_t mode);
}

void watchdogEnable(uint32_t timeout);
void watchdogReset(void);
void watchdogSetup(void);
void setup(void);
void loop(void);

class Print {
  public:
    virtual size_t write(uint8_t) = 0;
    virtual size_t write(const uint8_t* buffer, size_t size);
};

class Stream : public Print {
  public:
    virtual int available() = 0;
    virtual int read() = 0;
    virtual int peek() = 0;
    virtual void flush() = 0;
};

class UARTClass : public Stream {
  public:
    void begin(const uint32_t dwBaudRate);
    int available(void) override;
    int availableForWrite(void);
    int peek(void) override;
    int read(void) override;
    void flush(void) override;
    size_t write(const uint8_t c) override;
    using Print::write;
};

extern UARTClass Serial;
