// SPDX-FileCopyrightText: 2026 haptic_accel maintainers
// SPDX-License-Identifier: Apache-2.0

// The scope's clock as this page knows it, and the age of the newest sample.

const JUMP = 0.25; // s by which the clocks may drift apart before they are synchronised again
const FOLLOW = 0.05; // part of a difference by which the clock is corrected with each frame
const DRIFT = 1e-4; // s/s by which the steady clocks of two machines may drift apart

const steady = () => performance.now() / 1000;

/** The server's clock and this page's differ: the newest stamps show by how much. */
export const serverClock = {
  offset: null, // s; null before the first samples

  /** Follow the newest stamp, s since 1970. */
  meet(newest) {
    const found = newest - steady();
    if (this.offset === null || Math.abs(found - this.offset) > JUMP) this.offset = found;
    else this.offset += FOLLOW * (found - this.offset);
  },

  /** Time of the server, s since 1970; 0 while it is unknown. */
  get now() {
    return this.offset === null ? 0 : steady() + this.offset;
  },
};

/** Age of the newest sample: as the scope sent it, with the time it took from there until now. */
export const age = {
  forget() {
    this.found = null; // s, on arrival of the newest frame; null before the first
    this.at = 0; // s, time of that arrival
    this.least = Infinity; // s, difference of the two clocks with the shortest transit
  },

  /** Note an age in s, and when it was sent by the scope's steady clock, s. */
  meet(sent, when) {
    const now = steady();
    const transit = now - when;
    this.least = Math.min(this.least + DRIFT * (now - this.at), transit);
    this.found = sent + transit - this.least;
    this.at = now;
  },

  /** Age in s, negative if the sample is from the future; null while it is unknown. */
  get now() {
    return this.found === null ? null : this.found + steady() - this.at;
  },
};
age.forget();
