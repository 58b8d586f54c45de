// Copyright 2026 haptic_accel maintainers
// SPDX-License-Identifier: Apache-2.0

// As much of Teensy's Arduino as the sketch uses, to compile it on the host; nothing of it runs.
#pragma once

#include <stddef.h>
#include <stdint.h>
#include <stdio.h>

enum { A0 = 14, A1, A2, LOW = 0, HIGH = 1, OUTPUT = 1, INPUT_PULLUP = 2 };
constexpr uint32_t HW_OCOTP_MAC0 = 0;

uint32_t micros();
void pinMode(int pin, int mode);
void digitalWrite(int pin, int value);
int digitalRead(int pin);
int analogRead(int pin);
void analogReadResolution(int bits);
void analogReadAveraging(int number);

struct UsbSerial {
  void begin(long baud);
  int available();
  int read();
  int availableForWrite();
  size_t write(const uint8_t *bytes, size_t length);
  void send_now();
  int dtr();
};
extern UsbSerial Serial;

struct IntervalTimer {
  bool begin(void (*function)(), float microseconds);
  bool begin(void (*function)(), uint32_t microseconds);
  void update(float microseconds);
  void end();
};
