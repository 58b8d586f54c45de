// Copyright 2026 haptic_accel maintainers
// SPDX-License-Identifier: Apache-2.0

#include "protocol.h"

#include <string.h>

namespace haptic {

uint16_t read_u16(const uint8_t *bytes) {
  return static_cast<uint16_t>(bytes[0] | bytes[1] << 8);
}

uint32_t read_u32(const uint8_t *bytes) {
  return read_u16(bytes) | static_cast<uint32_t>(read_u16(bytes + 2)) << 16;
}

void write_u16(uint8_t *bytes, uint16_t value) {
  bytes[0] = static_cast<uint8_t>(value);
  bytes[1] = static_cast<uint8_t>(value >> 8);
}

void write_u32(uint8_t *bytes, uint32_t value) {
  write_u16(bytes, static_cast<uint16_t>(value));
  write_u16(bytes + 2, static_cast<uint16_t>(value >> 16));
}

void write_f32(uint8_t *bytes, float value) {
  uint32_t bits;
  static_assert(sizeof bits == sizeof value, "IEEE 754 single precision");
  memcpy(&bits, &value, sizeof bits);
  write_u32(bytes, bits);
}

uint16_t crc16(const uint8_t *bytes, size_t length) {
  uint16_t crc = 0xFFFF;
  for (size_t i = 0; i < length; i++) {
    crc = static_cast<uint16_t>(crc ^ bytes[i] << 8);
    for (int bit = 0; bit < 8; bit++) {
      const bool carry = crc & 0x8000;
      crc = static_cast<uint16_t>(crc << 1);
      if (carry) crc ^= 0x1021;
    }
  }
  return crc;
}

size_t encode(const Frame &frame, uint8_t wire[LONGEST_WIRE]) {
  uint8_t body[LONGEST_BODY];
  body[0] = frame.version;
  body[1] = frame.type;
  write_u16(body + 2, frame.sequence);
  write_u32(body + 4, frame.clock);
  memcpy(body + HEADER_SIZE, frame.payload, frame.length);
  const size_t content = HEADER_SIZE + frame.length;
  write_u16(body + content, crc16(body, content));

  // COBS: each zero is replaced by the distance to the next, which a first byte begins. A body is
  // too short for a distance that does not fit a byte.
  size_t zero = 0, end = 1;
  for (size_t i = 0; i < content + CRC_SIZE; i++) {
    if (body[i]) {
      wire[end++] = body[i];
    } else {
      wire[zero] = static_cast<uint8_t>(end - zero);
      zero = end++;
    }
  }
  wire[zero] = static_cast<uint8_t>(end - zero);
  wire[end++] = 0;
  return end;
}

bool decode(const uint8_t *stuffed, size_t length, Frame *frame) {
  if (length < 1 || length > LONGEST_ENCODED) return false;
  uint8_t body[LONGEST_ENCODED];
  size_t end = 0;
  for (size_t i = 0; i < length;) {
    const uint8_t distance = stuffed[i++];
    if (distance == 0 || i + distance - 1 > length) return false;
    memcpy(body + end, stuffed + i, distance - 1u);
    i += distance - 1u;
    end += distance - 1u;
    if (i < length) body[end++] = 0;
  }
  if (end < HEADER_SIZE + CRC_SIZE || end > LONGEST_BODY) return false;
  const size_t content = end - CRC_SIZE;
  if (crc16(body, content) != read_u16(body + content)) return false;
  frame->version = body[0];
  frame->type = body[1];
  frame->sequence = read_u16(body + 2);
  frame->clock = read_u32(body + 4);
  frame->length = content - HEADER_SIZE;
  memcpy(frame->payload, body + HEADER_SIZE, frame->length);
  return true;
}

bool Decoder::feed(uint8_t byte, Frame *frame) {
  if (byte == 0) return take(frame);
  if (length_ < LONGEST_ENCODED) {
    pending_[length_++] = byte;
  } else {
    too_long_ = true;
  }
  return false;
}

void Decoder::restart() {
  length_ = 0;
  too_long_ = false;
  expecting_ = false;
}

bool Decoder::take(Frame *frame) {
  const size_t length = length_;
  const bool too_long = too_long_;
  length_ = 0;
  too_long_ = false;
  if (length == 0) return false;
  if (too_long || !decode(pending_, length, frame)) {
    damaged++;
    return false;
  }
  received++;
  count_lost(frame->sequence);
  return true;
}

void Decoder::count_lost(uint16_t sequence) {
  const uint16_t gap = static_cast<uint16_t>(sequence - expected_);
  // More than half of all is a sender that has started anew.
  if (expecting_ && gap < 0x8000) lost += gap;
  expecting_ = true;
  expected_ = static_cast<uint16_t>(sequence + 1);
}

}  // namespace haptic
