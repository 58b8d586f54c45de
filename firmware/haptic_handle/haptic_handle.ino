// Copyright 2026 haptic_accel maintainers
// SPDX-License-Identifier: Apache-2.0

// Handle or tool on a Teensy 4.0: analogue accelerometer in, currents of up to three voice coils out.
//
// Protocol and rules are in board.cpp and protocol.cpp; here are only clock, pins and port. Wiring
// and reasons: haptic_accel/devices/serial. Set COILS to 3 for a handle with three coils, to 0 for a
// slave's tool.
#include <SPI.h>

#include "board.h"

#ifndef COILS
#define COILS 1  // 1 is along z
#endif
static_assert(COILS == 0 || COILS == 1 || COILS == 3, "no coil, one along z, or three");

// ADXL325 at 3.3 V: 174 mV/g at 3 V (data sheet), in proportion to the supply, is 191 mV/g. Half
// the converter's range is 1.65 V, 8.6 g. The calibration mends the tolerance.
const float FULL_SCALE_ACCELERATION = 84.6f;  // m/s^2 at 32767 counts
// A at 32767 counts: 6.6 N of a coil with 2.4 N/A; of the coils along x, y and z.
const float FULL_SCALE_CURRENTS[haptic::AXIS_COUNT] = {
    COILS == 3 ? 2.75f : 0.0f, COILS == 3 ? 2.75f : 0.0f, COILS ? 2.75f : 0.0f};
const uint8_t AXES = 0b111;                   // x, y, z are wired
const uint16_t HIGHEST_RATE = 10000;          // samples per second

const int ACCELEROMETER_PINS[haptic::AXIS_COUNT] = {A0, A1, A2};
const int CONVERTER_SELECT_PINS[haptic::AXIS_COUNT] = {8, 9, 10};  // MCP4921: 11 data, 13 clock
const int ENABLE_PIN = 2;  // of all amplifiers, high is on; 10 kOhm to ground keep them off
const int FAULT_PIN = 3;   // of any amplifier, low is a fault

const int INPUT_BITS = 12, INPUT_AVERAGING = 4;
const int INPUT_MIDDLE = 1 << (INPUT_BITS - 1);     // no acceleration
const int INPUT_SCALE = 1 << (16 - INPUT_BITS);     // from the converter's counts to 16 bits
const uint16_t OUTPUT_MIDDLE = 2048;                // no current
const int OUTPUT_SCALE = 16;                        // from 16 bits to the MCP4921's 12
const uint16_t OUTPUT_COMMAND = 0x3000;             // MCP4921: unbuffered, gain 1, on
const SPISettings OUTPUT_SETTINGS(20000000, MSBFIRST, SPI_MODE0);

const uint32_t GUARD_PERIOD = 1000;  // us
const uint32_t LONGEST_LOOP = 5000;  // us: a loop that hangs would let a current flow on

struct Sample {
  int16_t values[haptic::AXIS_COUNT];
  uint32_t clock;
};
const uint32_t WAITING = 64;  // samples; a power of two

Sample samples[WAITING];
volatile uint32_t taken = 0;   // counted by the sampler alone
volatile uint32_t passed = 0;  // counted by the loop alone
volatile uint32_t last_loop = 0;
volatile bool hung = false;

IntervalTimer sampler, guard;
uint16_t sampled_rate = 0;
uint32_t timed_period = 0;  // ns, given to the timer last
int16_t flowing[haptic::AXIS_COUNT] = {};
haptic::Board *board = nullptr;

bool send(void *, const uint8_t *bytes, size_t length) {
  // Never wait for the host: what has no room is lost, and counted.
  if (Serial.availableForWrite() < static_cast<int>(length)) return false;
  Serial.write(bytes, length);
  return true;
}

void take_sample() {
  if (taken - passed == WAITING) return;  // the clock will tell the host
  Sample &sample = samples[taken % WAITING];
  sample.clock = micros();
  for (int axis = 0; axis < haptic::AXIS_COUNT; axis++) {
    const int counts = analogRead(ACCELEROMETER_PINS[axis]) - INPUT_MIDDLE;
    sample.values[axis] = static_cast<int16_t>(counts * INPUT_SCALE);
  }
  taken = taken + 1;
}

void watch_loop() {
  if (micros() - last_loop > LONGEST_LOOP) {
    digitalWrite(ENABLE_PIN, LOW);
    hung = true;
  }
}

void put_out(int axis, int16_t current) {
  const uint16_t value = static_cast<uint16_t>(OUTPUT_MIDDLE + current / OUTPUT_SCALE);
  SPI.beginTransaction(OUTPUT_SETTINGS);
  digitalWrite(CONVERTER_SELECT_PINS[axis], LOW);
  SPI.transfer16(OUTPUT_COMMAND | value);
  digitalWrite(CONVERTER_SELECT_PINS[axis], HIGH);
  SPI.endTransaction();
}

// The number that the Teensy has on USB as well, so that a port and its board are known alike.
void write_serial_number(char text[16]) {
  uint32_t number = HW_OCOTP_MAC0 & 0xFFFFFF;
  if (number < 10000000) number *= 10;
  snprintf(text, 16, "%lu", static_cast<unsigned long>(number));
}

void setup() {
  pinMode(ENABLE_PIN, OUTPUT);
  digitalWrite(ENABLE_PIN, LOW);
  pinMode(FAULT_PIN, INPUT_PULLUP);
  for (const int pin : CONVERTER_SELECT_PINS) {
    pinMode(pin, OUTPUT);
    digitalWrite(pin, HIGH);
  }
  SPI.begin();
  for (int axis = 0; axis < haptic::AXIS_COUNT; axis++) put_out(axis, 0);
  analogReadResolution(INPUT_BITS);
  analogReadAveraging(INPUT_AVERAGING);

  haptic::Identity identity = {{3, 0, 0}, AXES, HIGHEST_RATE, FULL_SCALE_ACCELERATION, {}, {}};
  for (int axis = 0; axis < haptic::AXIS_COUNT; axis++) {
    identity.full_scale_currents[axis] = FULL_SCALE_CURRENTS[axis];
  }
  write_serial_number(identity.serial_number);
  static haptic::Board the_board(identity, send, nullptr);
  board = &the_board;
  Serial.begin(0);  // USB has no baud rate
  last_loop = micros();
  guard.begin(watch_loop, GUARD_PERIOD);
}

void listen() {
  uint8_t bytes[64];
  size_t length = 0;
  while (length < sizeof bytes && Serial.available()) {
    bytes[length++] = static_cast<uint8_t>(Serial.read());
  }
  board->receive(bytes, length, micros());
}

void pass_samples() {
  while (passed != taken) {
    const Sample sample = samples[passed % WAITING];
    passed = passed + 1;
    board->sample(sample.values, sample.clock);
  }
}

void follow_rate() {
  if (board->rate() == sampled_rate) return;
  sampler.end();
  passed = taken;  // of another rate
  sampled_rate = board->rate();
  timed_period = board->period();
  if (sampled_rate) sampler.begin(take_sample, timed_period / 1000.0f);
}

// The interval that runs is completed as it was; the next has the new length.
void follow_period() {
  if (board->period() == timed_period) return;
  timed_period = board->period();
  sampler.update(timed_period / 1000.0f);
}

void drive() {
  for (int axis = 0; axis < haptic::AXIS_COUNT; axis++) {
    const int16_t current = board->current(axis);
    if (current != flowing[axis]) put_out(axis, flowing[axis] = current);
  }
  const bool on = board->state() == haptic::ARMED || board->state() == haptic::TIMED_OUT;
  digitalWrite(ENABLE_PIN, on ? HIGH : LOW);
}

void loop() {
  last_loop = micros();
  const bool faulty = digitalRead(FAULT_PIN) == LOW || hung;
  hung = false;
  board->fault(faulty, micros());
  if (Serial.dtr()) {
    listen();
  } else {
    board->disconnect();
  }
  follow_rate();
  pass_samples();
  follow_period();
  board->tick(micros());
  drive();
  Serial.send_now();
}
