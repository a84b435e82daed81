#pragma once
// The first touch of fresh pages costs more than a copy into them. Pages of 2 MB are requested, of which there are 512
// times fewer; a system without them ignores the request. The touch needs no device, so that threads of their own do it
// while one works.

#include <sys/mman.h>

#include <algorithm>
#include <atomic>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <system_error>
#include <thread>
#include <vector>

namespace bromwich {

inline constexpr std::uintptr_t large_page = std::uintptr_t(1) << 21;  ///< bytes

/// For values that have not been written yet.
inline void ask_for_large_pages(double* values, std::size_t count) {
  const auto begin = (std::uintptr_t(values) + large_page - 1) / large_page * large_page;
  const auto end = std::uintptr_t(values + count) / large_page * large_page;
  if (begin < end) (void)madvise(reinterpret_cast<void*>(begin), end - begin, MADV_HUGEPAGE);
}

/// The same for values that will be written at once: their pages come in one call, where each of them would take a
/// fault.
inline void ask_for_pages([[maybe_unused]] double* values, [[maybe_unused]] std::size_t count) {
#ifdef MADV_POPULATE_WRITE
  constexpr std::uintptr_t page = 4096;
  const auto begin = (std::uintptr_t(values) + page - 1) / page * page;
  const auto end = std::uintptr_t(values + count) / page * page;
  if (begin < end) (void)madvise(reinterpret_cast<void*>(begin), end - begin, MADV_POPULATE_WRITE);
#endif
}

/// Touches the pages of `count` values from its construction to its destruction, which waits. Their contents are lost.
class FirstTouch {
 public:
  FirstTouch(double* values, std::size_t count) {
    const int wanted = std::clamp(int(std::thread::hardware_concurrency()) - 1, 0, most_threads);
    if (count < worth_it || wanted < 1) return;
    ask_for_large_pages(values, count);
    try {
      first_ = std::thread([=] { touch_with_others(values, count, wanted - 1); });
    } catch (const std::system_error&) {  // no more threads; copying touches the rest
    }
  }
  ~FirstTouch() {
    if (first_.joinable()) first_.join();
  }
  FirstTouch(const FirstTouch&) = delete;
  FirstTouch& operator=(const FirstTouch&) = delete;

 private:
  // The first thread starts the others: the caller goes on meanwhile. Each takes the next large page.
  static void touch_with_others(double* values, std::size_t count, int others) {
    const std::size_t before = std::uintptr_t(values) % large_page / sizeof(double);  // in the first page
    std::atomic<std::size_t> next = 0;
    const auto touch = [&] {
      for (std::size_t end; (end = together * ++next - before) < count + together;)
        for (std::size_t i = end < together ? 0 : end - together; i < std::min(count, end); i += page)
          values[i] = std::numeric_limits<double>::quiet_NaN();
    };
    std::vector<std::jthread> threads;
    try {
      while (others-- > 0) threads.emplace_back(touch);
    } catch (const std::system_error&) {
    }
    touch();
  }

  static constexpr int most_threads = 15;
  static constexpr std::size_t page = 4096 / sizeof(double), together = large_page / sizeof(double),
                               worth_it = std::size_t(1) << 19;

  std::thread first_;
};

}  // namespace bromwich
