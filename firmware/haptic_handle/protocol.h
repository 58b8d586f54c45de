// Copyright 2026 haptic_accel maintainers
// SPDX-License-Identifier: Apache-2.0

// Bytes and frames of the serial protocol (haptic_accel/devices/serial): no port, no clock, no Arduino.
//
// The same as haptic_accel/devices/serial/protocol.py, with which a test compares it byte for byte.
#pragma once

#include <stddef.h>
#include <stdint.h>

namespace haptic {

constexpr uint8_t VERSION = 3;           // of the protocol
constexpr int16_t FULL_SCALE = 32767;    // counts of the full-scale current either way
constexpr size_t LONGEST_PAYLOAD = 240;  // bytes: with header and CRC below the 254 of COBS
constexpr size_t HEADER_SIZE = 8;        // bytes: version, type, sequence number, clock
constexpr size_t CRC_SIZE = 2;           // bytes
constexpr size_t LONGEST_BODY = HEADER_SIZE + LONGEST_PAYLOAD + CRC_SIZE;
constexpr size_t LONGEST_ENCODED = LONGEST_BODY + 1;  // between delimiters
constexpr size_t LONGEST_WIRE = LONGEST_ENCODED + 1;  // with a delimiter

// What a frame is; those from the device have the highest bit.
enum FrameType : uint8_t {
  IDENTIFY = 0x01,
  CONFIGURE = 0x02,
  ARM = 0x03,
  DISARM = 0x04,
  SET_CURRENT = 0x05,
  SCHEDULE_CURRENT = 0x06,
  ALIGN = 0x07,
  IDENTITY = 0x81,
  CONFIGURATION = 0x82,
  SAMPLES = 0x83,
  STATUS = 0x84,
  ERROR = 0x85,
};

struct Frame {
  uint8_t version;
  uint8_t type;
  uint16_t sequence;  // the sender's count of frames
  uint32_t clock;     // the sender's, us; of samples, when the first was taken
  size_t length;      // of the payload
  uint8_t payload[LONGEST_PAYLOAD];
};

// Numbers of a payload, little-endian whatever the processor.
uint16_t read_u16(const uint8_t *bytes);
uint32_t read_u32(const uint8_t *bytes);
void write_u16(uint8_t *bytes, uint16_t value);
void write_u32(uint8_t *bytes, uint32_t value);
void write_f32(uint8_t *bytes, float value);

// CRC-16/CCITT-FALSE: polynomial 0x1021 from 0xFFFF, not reflected.
uint16_t crc16(const uint8_t *bytes, size_t length);

// Write a frame as it goes over the wire, its delimiter included; returns the number of bytes.
size_t encode(const Frame &frame, uint8_t wire[LONGEST_WIRE]);

// Read the frame between two delimiters; false where it is damaged.
bool decode(const uint8_t *stuffed, size_t length, Frame *frame);

// Finds frames in bytes as they come, from any place on.
class Decoder {
 public:
  // Take a byte; true if a frame ends with it.
  bool feed(uint8_t byte, Frame *frame);
  // Expect another sender, whose sequence begins anywhere.
  void restart();

  uint32_t received = 0;  // frames with an intact CRC
  uint32_t damaged = 0;   // stretches between delimiters that were none
  uint32_t lost = 0;      // frames missing, by their sequence numbers

 private:
  bool take(Frame *frame);
  void count_lost(uint16_t sequence);

  uint8_t pending_[LONGEST_ENCODED];
  size_t length_ = 0;
  bool too_long_ = false;
  bool expecting_ = false;
  uint16_t expected_ = 0;
};

}  // namespace haptic
