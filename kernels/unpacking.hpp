#pragma once
// Arrays with many zeros on their way to the host, y in contact: zeros need not cross the bus. An array is packed in
// segments (kernels/sparse_pieces.hpp). Segment s has its values other than zero at `packed` + s * segment_values, one
// after the other, and a bit for each of its values in `masks`, lowest first.
//
// Large arrays are written past the caches: an ordinary store reads the memory that it overwrites first, which costs
// threads that do nothing else more than half of their rate.

#if defined(__SSE2__)
#include <emmintrin.h>
#endif

#include <algorithm>
#include <array>
#include <bit>
#include <cstddef>
#include <cstdint>

namespace bromwich::cuda {

inline constexpr std::size_t segment_values = 256, segment_masks = segment_values / 64;

constexpr std::size_t segments_of(std::size_t values) { return (values + segment_values - 1) / segment_values; }

/// Copies past the caches. Call `end_streams` before another thread may read the values.
inline void stream_copy(const double* from, std::size_t count, double* to) {
#if defined(__SSE2__)
  constexpr std::size_t line = 64, values = line / sizeof(double);
  const std::size_t beyond = reinterpret_cast<std::uintptr_t>(to) % line / sizeof(double);
  const std::size_t head = std::min(count, (values - beyond) % values);
  std::copy_n(from, head, to);
  std::size_t i = head;
  for (; i + values <= count; i += values)
    for (std::size_t k = 0; k < values; k += 2) _mm_stream_pd(to + i + k, _mm_loadu_pd(from + i + k));
  std::copy_n(from + i, count - i, to + i);
#else
  std::copy_n(from, count, to);
#endif
}

inline void end_streams() {
#if defined(__SSE2__)
  _mm_sfence();
#endif
}

/// Rows of `step` values in segments, contiguous rows of `cols` <= `step` values on the host.
struct PaddedRows {
  std::size_t step, cols, rows;
};

/// Writes the values of segments first .. last - 1 to their rows. Returns how many are not zero.
inline std::size_t unpack_segments(const double* packed, const std::uint64_t* masks, std::size_t first,
                                   std::size_t last, const PaddedRows& shape, double* to) {
  constexpr std::size_t word = 64, together = 16;  // segments
  std::array<double, together * segment_values> values;
  std::size_t found = 0, row = first * segment_values / shape.step, column = first * segment_values % shape.step;
  for (std::size_t begin = first; begin < last; begin += together) {
    const std::size_t end = std::min(begin + together, last);
    for (std::size_t s = begin; s < end; ++s) {
      const double* next = packed + s * segment_values;
      for (std::size_t w = 0; w < segment_masks; ++w) {
        double* const at = values.data() + (s - begin) * segment_values + w * word;
        std::uint64_t mask = masks[s * segment_masks + w];
        found += std::size_t(std::popcount(mask));
        if (~mask == 0) {
          std::copy_n(next, word, at);
          next += word;
          continue;
        }
        std::fill_n(at, word, 0.0);
        for (; mask != 0; mask &= mask - 1) at[std::countr_zero(mask)] = *next++;
      }
    }
    const std::size_t count = (end - begin) * segment_values;
    for (std::size_t i = 0; i < count && row < shape.rows;) {
      const std::size_t there = std::min(count - i, shape.step - column);
      if (column < shape.cols)
        stream_copy(values.data() + i, std::min(there, shape.cols - column), to + row * shape.cols + column);
      i += there, column += there;
      if (column == shape.step) column = 0, ++row;
    }
  }
  end_streams();
  return found;
}

}  // namespace bromwich::cuda
