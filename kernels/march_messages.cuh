#pragma once
// Messages between the blocks of one launch. A message is one 8-byte word: a double whose last two bits are replaced.
// The receiver polls it until the turn bit changes, which needs neither a barrier nor a fence. Messages alternate
// between two buffers, cleared before the launch: a sender reuses a buffer only after it has received the answers of
// all blocks to the message in between. Message numbers begin at 1.

#include <cuda_runtime.h>

#include <cmath>

namespace bromwich::cuda {

__device__ inline unsigned long long turn(unsigned number) { return (number + 1) / 2 % 2; }

/// The value as sent, rounded to 51 bits. Infinite if it, or a result computed from it, is not finite.
__device__ inline double to_send(double value, bool finite) {
  return finite ? __longlong_as_double((__double_as_longlong(value) + 2) & ~3ll) : INFINITY;
}

__device__ inline void send(unsigned long long* to, double value, unsigned number, bool wrong_sign) {
  asm volatile("st.relaxed.gpu.global.u64 [%0], %1;" ::"l"(__cvta_generic_to_global(to)),
               "l"(__double_as_longlong(value) | (wrong_sign ? 2 : 0) | turn(number))
               : "memory");
}

__device__ inline double receive(const unsigned long long* from, unsigned number, bool& wrong_sign) {
  const unsigned long long mine = turn(number);
  unsigned long long bits;
  do {
    asm volatile("ld.relaxed.gpu.global.u64 %0, [%1];" : "=l"(bits) : "l"(__cvta_generic_to_global(from)) : "memory");
  } while ((bits & 1) != mine);
  wrong_sign = (bits & 2) != 0;
  return __longlong_as_double(bits & ~3ull);
}

}  // namespace bromwich::cuda
