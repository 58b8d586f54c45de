// Copyright 2026 haptic_accel maintainers
// SPDX-License-Identifier: Apache-2.0

// Runs the firmware's protocol on the host: what happens to a board comes in on standard input,
// what the board does goes out on standard output. Records begin with a letter; numbers are
// little-endian.
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "board.h"

namespace {

uint8_t taken[1 << 16];  // what was last taken from the input

const uint8_t *take(size_t length) {
  if (fread(taken, 1, length, stdin) != length) abort();
  return taken;
}

uint32_t take_u32() { return haptic::read_u32(take(4)); }

uint16_t take_u16() { return haptic::read_u16(take(2)); }

void give(char letter, const uint8_t *bytes, size_t length) {
  uint8_t head[3] = {static_cast<uint8_t>(letter)};
  haptic::write_u16(head + 1, static_cast<uint16_t>(length));
  fwrite(head, 1, sizeof head, stdout);
  fwrite(bytes, 1, length, stdout);
}

bool room = true;

bool send(void *, const uint8_t *bytes, size_t length) {
  if (room) give('F', bytes, length);
  return room;
}

// Decode what comes and encode it again.
void echo(haptic::Decoder &decoder, const uint8_t *bytes, size_t length) {
  haptic::Frame frame;
  uint8_t wire[haptic::LONGEST_WIRE];
  for (size_t i = 0; i < length; i++) {
    if (decoder.feed(bytes[i], &frame)) give('F', wire, haptic::encode(frame, wire));
  }
  uint8_t counts[12];
  haptic::write_u32(counts, decoder.received);
  haptic::write_u32(counts + 4, decoder.damaged);
  haptic::write_u32(counts + 8, decoder.lost);
  give('C', counts, sizeof counts);
}

void show(const haptic::Board &board) {
  uint8_t state[13] = {board.state()};
  for (int axis = 0; axis < haptic::AXIS_COUNT; axis++) {
    haptic::write_u16(state + 1 + 2 * axis, static_cast<uint16_t>(board.current(axis)));
  }
  haptic::write_u16(state + 7, board.rate());
  haptic::write_u32(state + 9, board.period());
  give('S', state, sizeof state);
}

void run(const haptic::Identity &identity) {
  haptic::Board board(identity, send, nullptr);
  haptic::Decoder decoder;
  for (int letter; (letter = getchar()) != EOF;) {
    if (letter == 'e') {
      const uint16_t length = take_u16();
      echo(decoder, take(length), length);
      continue;
    }
    if (letter == 'd') board.disconnect();
    if (letter == 'm') room = take(1)[0];
    if (letter == 't') board.tick(take_u32());
    if (letter == 'f') {
      const bool present = take(1)[0];
      board.fault(present, take_u32());
    }
    if (letter == 's') {
      const uint32_t now = take_u32();
      int16_t values[haptic::AXIS_COUNT];
      for (int16_t &value : values) value = static_cast<int16_t>(take_u16());
      board.sample(values, now);
    }
    if (letter == 'r') {
      const uint32_t now = take_u32();
      const uint16_t length = take_u16();
      board.receive(take(length), length, now);
    }
    show(board);
  }
}

}  // namespace

// The identity's payload comes first, and tells the board what it is.
int main() {
  const uint8_t *payload = take(38);
  haptic::Identity identity;
  memcpy(identity.firmware, payload, 3);
  identity.axes = payload[3];
  identity.highest_rate = haptic::read_u16(payload + 4);
  memcpy(&identity.full_scale_acceleration, payload + 6, 4);
  memcpy(identity.full_scale_currents, payload + 10, sizeof identity.full_scale_currents);
  memcpy(identity.serial_number, payload + 22, 16);
  run(identity);
}
