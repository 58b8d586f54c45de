// Copyright 2026 haptic_accel maintainers
// SPDX-License-Identifier: Apache-2.0

#pragma once

#include "Arduino.h"

enum { MSBFIRST = 1, SPI_MODE0 = 0 };

struct SPISettings {
  SPISettings(uint32_t clock, uint8_t order, uint8_t mode);
};

struct SpiPort {
  void begin();
  void beginTransaction(const SPISettings &settings);
  uint16_t transfer16(uint16_t value);
  void endTransaction();
};
extern SpiPort SPI;
