// Copyright 2026 haptic_accel maintainers
// SPDX-License-Identifier: Apache-2.0

// Starts a program on a bare Cortex-M7, the one of QEMU's machine mps2-an500. newlib's librdimon
// then passes files and the end of the program to the machine that emulates it.
#include <stdint.h>
#include <stdio.h>

extern "C" {
void _start();  // newlib's: memory, static constructors, main
void reset();
}

namespace {

constexpr uintptr_t END_OF_RAM = 0x400000;            // of the RAM at 0
constexpr uintptr_t COPROCESSOR_ACCESS = 0xE000ED88;  // the register CPACR of ARMv7-M
constexpr uint32_t FLOATING_POINT = 0xF << 20;        // full access to CP10 and CP11

struct Vectors {
  uintptr_t stack;
  void (*reset)();
};
// The linker puts them at 0, where the processor reads them. An exception finds no handler there,
// and stops QEMU with an error.
__attribute__((section(".vectors"), used)) const Vectors vectors = {END_OF_RAM, reset};

// The console of QEMU knows no end of input, these do.
const bool opened [[maybe_unused]] =
    freopen("/dev/stdin", "rb", stdin) && freopen("/dev/stdout", "wb", stdout);

}  // namespace

// The floating-point unit is off at first, and without it hard floats are a fault.
void reset() {
  *reinterpret_cast<volatile uint32_t *>(COPROCESSOR_ACCESS) = FLOATING_POINT;
  asm volatile("dsb\n\tisb");
  _start();
}
