// Copyright 2026 haptic_accel maintainers
// SPDX-License-Identifier: Apache-2.0

// The device's side of the protocol: obeys the host, sends samples, takes the current off.
//
// Nothing here knows the time, a port or a pin: all are given, so that the host compiles it too.
// The same as haptic_accel/kits/emulators/serial_line.py, with which a test compares it. Times are us of
// the device's clock and may begin anew; periods are ns, so that none is rounded noticeably.
#pragma once

#include "protocol.h"

namespace haptic {

constexpr uint32_t SET_POINT_TIMEOUT = 5000;  // us without a set-point while a current may flow
constexpr uint32_t STATUS_PERIOD = 100000;    // us: a status is sent as often unasked
constexpr uint16_t LOWEST_RATE = 50;          // samples per second
constexpr int ROOM = 32;                      // scheduled set-points; the largest latency is 20
constexpr int32_t LONGEST_LEAD = 500000;      // us from a set-point's arrival until it is due
constexpr int AXIS_COUNT = 3;                 // x, y, z, one bit each, x the lowest

enum State : uint8_t { DISARMED = 0, ARMED = 1, TIMED_OUT = 2, FAULT = 3 };

// Why a frame was refused.
enum ErrorCode : uint8_t {
  NO_ERROR = 0,
  BAD_VERSION = 1,
  BAD_TYPE = 2,
  BAD_LENGTH = 3,
  BAD_VALUE = 4,
  NO_ACTUATOR = 5,
  IN_FAULT = 6,
};

struct Identity {
  uint8_t firmware[3];           // major, minor, patch
  uint8_t axes;                  // of the accelerometer
  uint16_t highest_rate;         // samples per second
  float full_scale_acceleration; // nominal, of 32767 counts, m/s^2
  float full_scale_currents[AXIS_COUNT];  // of FULL_SCALE counts, A; 0 where there is no coil
  char serial_number[16];        // padded with zeros
};

// Takes the bytes of a frame; says whether there was room for them.
typedef bool (*Send)(void *context, const uint8_t *bytes, size_t length);

class Board {
 public:
  Board(const Identity &identity, Send send, void *context);

  // Take bytes of the host.
  void receive(const uint8_t *bytes, size_t length, uint32_t now);
  // Take the sample of a tick, counts by axis, and the moment it was taken at; then the set-points
  // that are due flow.
  void sample(const int16_t values[AXIS_COUNT], uint32_t now);
  // Look at the time: to be called at least every ms.
  void tick(uint32_t now);
  // Take what the amplifier says of itself; a fault stays until the host disarms.
  void fault(bool present, uint32_t now);
  // Let go of a host that has closed the port; counts stay.
  void disconnect();

  State state() const { return state_; }
  uint16_t rate() const { return rate_; }      // of the samples wanted; 0 for none
  uint32_t period() const { return period_; }  // from this tick to the next, ns
  // The current that is to flow in the coil of an axis, counts of FULL_SCALE.
  int16_t current(int axis) const { return currents_[axis]; }

 private:
  void execute(const Frame &frame, uint32_t now);
  bool has_coil(int axis) const { return identity_.full_scale_currents[axis] > 0; }
  int coil_count() const;
  ErrorCode refusal(const Frame &frame) const;
  bool can(const Frame &frame) const;
  bool can_follow(const Frame &frame) const;
  void configure(const Frame &frame, uint32_t now);
  void align(const Frame &frame);
  void follow_grid(uint32_t now);
  bool passed(uint32_t due) const;
  void apply_due();
  void take_set_point(const Frame &frame, uint32_t now);
  struct SetPoint {
    uint32_t due;
    int16_t counts[AXIS_COUNT];  // 0 where there is no coil
  };
  void schedule(const SetPoint &set_point);
  void apply(const SetPoint &set_point);
  void switch_off();
  void enter(State state, uint32_t now);
  void report(uint32_t now);
  void identify(uint32_t now);
  void send_configuration(uint32_t now);
  void send_samples();
  void send(uint8_t type, const uint8_t *payload, size_t length, uint32_t now);
  void be_silent();

  Identity identity_;
  Send send_;
  void *context_;
  Decoder decoder_;
  State state_ = DISARMED;
  int16_t currents_[AXIS_COUNT] = {};
  uint16_t rate_ = 0;
  uint8_t axes_ = 0;
  uint8_t samples_per_frame_ = 0;
  uint16_t sequence_ = 0;
  uint32_t index_ = 0;
  uint8_t pending_[LONGEST_PAYLOAD];  // of a frame of samples
  size_t pending_length_ = 0;
  uint8_t pending_samples_ = 0;
  uint32_t pending_clock_ = 0;
  SetPoint scheduled_[ROOM];  // in the order in which they are due
  int scheduled_length_ = 0;
  uint32_t period_ = 0;
  uint32_t grid_ = 0;           // point nearest to the last tick, whole us
  uint32_t grid_fraction_ = 0;  // and ns beyond
  uint32_t grid_period_ = 0;    // ns; 0 for no grid to follow
  uint32_t last_tick_ = 0;
  bool ticked_ = false;
  uint32_t last_set_ = 0;
  uint32_t last_status_ = 0;
  bool heard_ = false;
  bool faulty_ = false;
  uint32_t refused_ = 0;
  uint32_t timeouts_ = 0;
  uint32_t unsent_ = 0;
  uint32_t late_ = 0;
  uint32_t overflowed_ = 0;
};

}  // namespace haptic
