#pragma once
// The first touch of fresh pages costs more than a copy into them. It needs no device, so that threads of their own do
// it while one works. Pages of 2 MB are asked for, of which there are 512 times fewer; a system without them ignores
// it.

#include <sys/mman.h>

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <system_error>
#include <thread>
#include <vector>

namespace bromwich {

/// Touches the pages of `count` values from its construction to its destruction, which waits. Their contents are lost.
class FirstTouch {
 public:
  FirstTouch(double* values, std::size_t count) {
    const auto wanted = std::size_t(std::clamp(int(std::thread::hardware_concurrency()) - 1, 0, most_threads));
    if (count < worth_it) return;
    ask_for_large_pages(values, count);
    try {
      for (std::size_t k = 0; k < wanted; ++k)
        threads_.emplace_back([=] {
          for (std::size_t i = count * k / wanted; i < count * (k + 1) / wanted; i += page)
            values[i] = std::numeric_limits<double>::quiet_NaN();
        });
    } catch (const std::system_error&) {  // no more threads: who copies touches the rest
    }
  }
  ~FirstTouch() {
    for (std::thread& thread : threads_) thread.join();
  }
  FirstTouch(const FirstTouch&) = delete;
  FirstTouch& operator=(const FirstTouch&) = delete;

 private:
  static void ask_for_large_pages(double* values, std::size_t count) {
    constexpr std::uintptr_t large = std::uintptr_t(1) << 21;
    const auto begin = (std::uintptr_t(values) + large - 1) / large * large;
    const auto end = std::uintptr_t(values + count) / large * large;
    if (begin < end) (void)madvise(reinterpret_cast<void*>(begin), end - begin, MADV_HUGEPAGE);
  }

  static constexpr int most_threads = 8;
  static constexpr std::size_t page = 4096 / sizeof(double), worth_it = std::size_t(1) << 19;

  std::vector<std::thread> threads_;
};

}  // namespace bromwich
