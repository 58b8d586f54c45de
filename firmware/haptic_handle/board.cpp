// Copyright 2026 haptic_accel maintainers
// SPDX-License-Identifier: Apache-2.0

#include "board.h"

#include <string.h>

namespace haptic {

namespace {

constexpr size_t SAMPLES_HEAD = 6;  // bytes before the samples: index, axes, number
constexpr int64_t SECOND = 1000000000, MICROSECOND = 1000;  // ns
constexpr int TOLERANCE = 64;       // a grid's period may differ by this part of it
constexpr int LARGEST_STEP = 32;    // an interval differs by at most this part of the grid's
// Ticks in which a distance from the grid is removed. A timer takes a new interval over one tick
// later, with which a quarter is the fastest correction that does not overshoot.
constexpr int SMOOTHING = 4;

int axis_count(uint8_t axes) {
  int count = 0;
  for (int axis = 0; axis < AXIS_COUNT; axis++) count += axes >> axis & 1;
  return count;
}

// Rounds down, where C++ rounds towards zero; b is positive.
int64_t floor_div(int64_t a, int64_t b) { return a / b - (a % b < 0); }

// Time from one moment to another, us; either may be the later one.
int32_t difference(uint32_t later, uint32_t earlier) {
  return static_cast<int32_t>(later - earlier);
}

// Bytes of the payload that a frame of the host has for a number of coils; -1 for a type that no
// host sends.
int payload_length(uint8_t type, int coils) {
  switch (type) {
    case IDENTIFY:
    case ARM:
    case DISARM:
      return 0;
    case CONFIGURE:
      return 4;
    case SET_CURRENT:
      return 2 * coils;
    case SCHEDULE_CURRENT:
      return 2 * coils + 4;
    case ALIGN:
      return 8;
    default:
      return -1;
  }
}

}  // namespace

Board::Board(const Identity &identity, Send send, void *context)
    : identity_(identity), send_(send), context_(context) {}

void Board::receive(const uint8_t *bytes, size_t length, uint32_t now) {
  Frame frame;
  for (size_t i = 0; i < length; i++) {
    if (!decoder_.feed(bytes[i], &frame)) continue;
    if (!heard_) {
      heard_ = true;
      last_status_ = now;
    }
    execute(frame, now);
  }
}

void Board::sample(const int16_t values[AXIS_COUNT], uint32_t now) {
  if (!rate_) return;
  follow_grid(now);
  last_tick_ = now;
  ticked_ = true;
  apply_due();
  if (!pending_samples_) {
    pending_clock_ = now;
    pending_length_ = SAMPLES_HEAD;
  }
  for (int axis = 0; axis < AXIS_COUNT; axis++) {
    if (!(axes_ >> axis & 1)) continue;
    write_u16(pending_ + pending_length_, static_cast<uint16_t>(values[axis]));
    pending_length_ += 2;
  }
  if (++pending_samples_ == samples_per_frame_) send_samples();
}

void Board::tick(uint32_t now) {
  if (state_ == ARMED && now - last_set_ > SET_POINT_TIMEOUT) {
    timeouts_++;
    enter(TIMED_OUT, now);
  }
  if (heard_ && now - last_status_ >= STATUS_PERIOD) report(now);
}

void Board::fault(bool present, uint32_t now) {
  const bool appeared = present && !faulty_;
  faulty_ = present;
  if (appeared) enter(FAULT, now);
}

void Board::disconnect() {
  decoder_.restart();
  be_silent();
  heard_ = false;
  switch_off();
  if (state_ != FAULT) state_ = DISARMED;
}

void Board::execute(const Frame &frame, uint32_t now) {
  const ErrorCode code = refusal(frame);
  if (code != NO_ERROR) {
    uint8_t payload[4] = {code, frame.type};
    write_u16(payload + 2, frame.sequence);
    send(ERROR, payload, sizeof payload, now);
    return;
  }
  switch (frame.type) {
    case IDENTIFY:
      identify(now);
      break;
    case CONFIGURE:
      configure(frame, now);
      break;
    case ALIGN:
      align(frame);
      break;
    case ARM:
      if (state_ == ARMED) {
        report(now);
      } else {
        last_set_ = now;
        enter(ARMED, now);
      }
      break;
    case DISARM:
      enter(DISARMED, now);
      break;
    case SET_CURRENT:
    case SCHEDULE_CURRENT:
      take_set_point(frame, now);
      break;
  }
}

int Board::coil_count() const {
  int count = 0;
  for (int axis = 0; axis < AXIS_COUNT; axis++) count += has_coil(axis);
  return count;
}

ErrorCode Board::refusal(const Frame &frame) const {
  const int coils = coil_count();
  if (frame.version != VERSION) return BAD_VERSION;
  const int length = payload_length(frame.type, coils);
  if (length < 0) return BAD_TYPE;
  const bool sets = frame.type == SET_CURRENT || frame.type == SCHEDULE_CURRENT;
  if ((frame.type == ARM || sets) && !coils) return NO_ACTUATOR;
  if (frame.length != static_cast<size_t>(length)) return BAD_LENGTH;
  if (frame.type == ARM && state_ == FAULT) return IN_FAULT;
  if (frame.type == DISARM && faulty_) return IN_FAULT;
  if (frame.type == CONFIGURE && !can(frame)) return BAD_VALUE;
  if (frame.type == ALIGN && !can_follow(frame)) return BAD_VALUE;
  return NO_ERROR;
}

bool Board::can(const Frame &frame) const {
  const uint16_t rate = read_u16(frame.payload);
  const uint8_t axes = frame.payload[2];
  const uint8_t samples = frame.payload[3];
  if (rate == 0) return true;
  if (rate < LOWEST_RATE || rate > identity_.highest_rate) return false;
  if (axes == 0 || (axes & ~identity_.axes)) return false;
  const size_t most = (LONGEST_PAYLOAD - SAMPLES_HEAD) / (2u * axis_count(axes));
  return samples >= 1 && samples <= most;
}

bool Board::can_follow(const Frame &frame) const {
  const int64_t error = static_cast<int64_t>(read_u32(frame.payload + 4)) * rate_ - SECOND;
  return rate_ && error <= SECOND / TOLERANCE && -error <= SECOND / TOLERANCE;
}

void Board::configure(const Frame &frame, uint32_t now) {
  be_silent();
  rate_ = read_u16(frame.payload);
  // Without samples, axes and number mean nothing.
  axes_ = rate_ ? frame.payload[2] : 0;
  samples_per_frame_ = rate_ ? frame.payload[3] : 0;
  period_ = rate_ ? static_cast<uint32_t>((SECOND + rate_ / 2) / rate_) : 0;
  send_configuration(now);
}

void Board::align(const Frame &frame) {
  grid_ = read_u32(frame.payload);
  grid_fraction_ = 0;
  grid_period_ = read_u32(frame.payload + 4);
}

// Go to the point of the grid that is nearest to a tick, and move the next tick to the next.
void Board::follow_grid(uint32_t now) {
  if (!grid_period_) return;
  const int64_t period = grid_period_;
  const int64_t distance = difference(now, grid_) * MICROSECOND - grid_fraction_;
  const int64_t points = floor_div(distance + period / 2, period);
  const int64_t fraction = grid_fraction_ + points * period;
  const int64_t whole = floor_div(fraction, MICROSECOND);
  grid_ += static_cast<uint32_t>(whole);
  grid_fraction_ = static_cast<uint32_t>(fraction - whole * MICROSECOND);
  const int64_t largest = period / LARGEST_STEP;
  int64_t step = (distance - points * period) / SMOOTHING;
  if (step > largest) step = largest;
  if (step < -largest) step = -largest;
  period_ = static_cast<uint32_t>(period - step);
}

// Whether a set-point is due at the last tick or an earlier one.
bool Board::passed(uint32_t due) const {
  return 2 * MICROSECOND * difference(due, last_tick_) <= static_cast<int64_t>(period_);
}

void Board::apply_due() {
  int number = 0;
  while (number < scheduled_length_ && passed(scheduled_[number].due)) number++;
  if (!number) return;
  apply(scheduled_[number - 1]);
  scheduled_length_ -= number;
  memmove(scheduled_, scheduled_ + number, sizeof(SetPoint) * scheduled_length_);
}

void Board::take_set_point(const Frame &frame, uint32_t now) {
  SetPoint set_point = {now, {}};
  const uint8_t *next = frame.payload;
  for (int axis = 0; axis < AXIS_COUNT; axis++) {
    if (!has_coil(axis)) continue;
    set_point.counts[axis] = static_cast<int16_t>(read_u16(next));
    next += 2;
  }
  const bool scheduled = frame.type == SCHEDULE_CURRENT;
  if (scheduled) set_point.due = read_u32(next);
  const bool too_early = difference(set_point.due, now) > LONGEST_LEAD;
  if (too_early || (state_ != ARMED && state_ != TIMED_OUT)) {
    refused_++;
    return;
  }
  state_ = ARMED;
  last_set_ = now;
  if (scheduled && ticked_) {
    schedule(set_point);
  } else {
    scheduled_length_ = 0;
    apply(set_point);
  }
}

// Keep a set-point until its tick, in the order in which they are due.
void Board::schedule(const SetPoint &set_point) {
  const uint32_t due = set_point.due;
  if (passed(due)) {
    late_++;
    apply(set_point);
  } else if (scheduled_length_ == ROOM) {
    overflowed_++;
  } else {
    int place = scheduled_length_++;
    for (; place && difference(scheduled_[place - 1].due, due) > 0; place--) {
      scheduled_[place] = scheduled_[place - 1];
    }
    scheduled_[place] = set_point;
  }
}

void Board::apply(const SetPoint &set_point) {
  for (int axis = 0; axis < AXIS_COUNT; axis++) {
    const int16_t counts = set_point.counts[axis];
    currents_[axis] = counts < -FULL_SCALE ? static_cast<int16_t>(-FULL_SCALE) : counts;
  }
}

void Board::switch_off() { memset(currents_, 0, sizeof currents_); }

// Whatever the change, no current flows until a set-point comes.
void Board::enter(State state, uint32_t now) {
  state_ = state;
  switch_off();
  scheduled_length_ = 0;
  report(now);
}

void Board::report(uint32_t now) {
  last_status_ = now;
  uint8_t payload[33 + 2 * AXIS_COUNT] = {state_};
  uint8_t *next = payload + 1;
  for (int axis = 0; axis < AXIS_COUNT; axis++) {
    if (!has_coil(axis)) continue;
    write_u16(next, static_cast<uint16_t>(currents_[axis]));
    next += 2;
  }
  const uint32_t counts[] = {decoder_.received, decoder_.damaged, decoder_.lost,
                             refused_,          timeouts_,        unsent_,
                             late_,             overflowed_};
  for (size_t i = 0; i < 8; i++, next += 4) write_u32(next, counts[i]);
  send(STATUS, payload, static_cast<size_t>(next - payload), now);
}

void Board::identify(uint32_t now) {
  uint8_t payload[38];
  memcpy(payload, identity_.firmware, 3);
  payload[3] = identity_.axes;
  write_u16(payload + 4, identity_.highest_rate);
  write_f32(payload + 6, identity_.full_scale_acceleration);
  for (int axis = 0; axis < AXIS_COUNT; axis++) {
    write_f32(payload + 10 + 4 * axis, identity_.full_scale_currents[axis]);
  }
  memcpy(payload + 22, identity_.serial_number, sizeof identity_.serial_number);
  send(IDENTITY, payload, sizeof payload, now);
}

void Board::send_configuration(uint32_t now) {
  uint8_t payload[4] = {0, 0, axes_, samples_per_frame_};
  write_u16(payload, rate_);
  send(CONFIGURATION, payload, sizeof payload, now);
}

void Board::send_samples() {
  write_u32(pending_, index_);
  pending_[4] = axes_;
  pending_[5] = pending_samples_;
  send(SAMPLES, pending_, pending_length_, pending_clock_);
  index_ += pending_samples_;
  pending_samples_ = 0;
}

void Board::send(uint8_t type, const uint8_t *payload, size_t length, uint32_t now) {
  if (!heard_) return;
  Frame frame;
  frame.version = VERSION;
  frame.type = type;
  frame.sequence = sequence_++;
  frame.clock = now;
  frame.length = length;
  memcpy(frame.payload, payload, length);
  uint8_t wire[LONGEST_WIRE];
  if (!send_(context_, wire, encode(frame, wire))) unsent_++;
}

void Board::be_silent() {
  rate_ = 0;
  axes_ = 0;
  samples_per_frame_ = 0;
  index_ = 0;
  pending_samples_ = 0;
  period_ = 0;
  grid_period_ = 0;
  ticked_ = false;
  scheduled_length_ = 0;
}

}  // namespace haptic
