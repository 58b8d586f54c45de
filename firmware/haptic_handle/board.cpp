#include "board.h"

#include <string.h>

namespace haptic {

namespace {

constexpr size_t SAMPLES_HEAD = 6;  // bytes before the samples: index, axes, number

int axis_count(uint8_t axes) {
  int count = 0;
  for (int axis = 0; axis < AXIS_COUNT; axis++) count += axes >> axis & 1;
  return count;
}

// Bytes of the payload that a frame of the host has; -1 for a type that no host sends.
int payload_length(uint8_t type) {
  switch (type) {
    case IDENTIFY:
    case ARM:
    case DISARM:
      return 0;
    case CONFIGURE:
      return 4;
    case SET_CURRENT:
      return 2;
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
  current_ = 0;
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
      set_current(static_cast<int16_t>(read_u16(frame.payload)), now);
      break;
  }
}

ErrorCode Board::refusal(const Frame &frame) const {
  const bool has_actuator = identity_.full_scale_current > 0;
  if (frame.version != VERSION) return BAD_VERSION;
  const int length = payload_length(frame.type);
  if (length < 0) return BAD_TYPE;
  if (frame.length != static_cast<size_t>(length)) return BAD_LENGTH;
  if ((frame.type == ARM || frame.type == SET_CURRENT) && !has_actuator) return NO_ACTUATOR;
  if (frame.type == ARM && state_ == FAULT) return IN_FAULT;
  if (frame.type == DISARM && faulty_) return IN_FAULT;
  if (frame.type == CONFIGURE && !can(frame)) return BAD_VALUE;
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

void Board::configure(const Frame &frame, uint32_t now) {
  be_silent();
  rate_ = read_u16(frame.payload);
  // Without samples, axes and number mean nothing.
  axes_ = rate_ ? frame.payload[2] : 0;
  samples_per_frame_ = rate_ ? frame.payload[3] : 0;
  index_ = 0;
  send_configuration(now);
}

void Board::set_current(int16_t counts, uint32_t now) {
  if (state_ != ARMED && state_ != TIMED_OUT) {
    refused_++;
    return;
  }
  state_ = ARMED;
  last_set_ = now;
  current_ = counts < -FULL_SCALE ? static_cast<int16_t>(-FULL_SCALE) : counts;
}

// Whatever the change, no current flows until a set-point comes.
void Board::enter(State state, uint32_t now) {
  state_ = state;
  current_ = 0;
  report(now);
}

void Board::report(uint32_t now) {
  last_status_ = now;
  uint8_t payload[27] = {state_};
  write_u16(payload + 1, static_cast<uint16_t>(current_));
  const uint32_t counts[] = {decoder_.received, decoder_.damaged, decoder_.lost,
                             refused_,          timeouts_,        unsent_};
  for (size_t i = 0; i < 6; i++) write_u32(payload + 3 + 4 * i, counts[i]);
  send(STATUS, payload, sizeof payload, now);
}

void Board::identify(uint32_t now) {
  uint8_t payload[30];
  memcpy(payload, identity_.firmware, 3);
  payload[3] = identity_.axes;
  write_u16(payload + 4, identity_.highest_rate);
  write_f32(payload + 6, identity_.full_scale_acceleration);
  write_f32(payload + 10, identity_.full_scale_current);
  memcpy(payload + 14, identity_.serial_number, sizeof identity_.serial_number);
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
  pending_samples_ = 0;
}

}  // namespace haptic
