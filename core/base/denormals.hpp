#pragma once

#if defined(__SSE2__)
#include <xmmintrin.h>
#endif

namespace bromwich {

/// While this object lives, the calling thread treats denormals as zero. Decaying exponentials end in denormals, which
/// cost a hundred cycles each.
class FlushDenormals {
 public:
#if defined(__SSE2__)
  FlushDenormals() : saved_(_mm_getcsr()) { _mm_setcsr(saved_ | 0x8040); }
  ~FlushDenormals() { _mm_setcsr(saved_); }
#else
  FlushDenormals() {}
#endif
  FlushDenormals(const FlushDenormals&) = delete;
  FlushDenormals& operator=(const FlushDenormals&) = delete;

 private:
  [[maybe_unused]] unsigned saved_ = 0;
};

}  // namespace bromwich
