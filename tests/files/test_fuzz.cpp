// Scene files, tables and matrices with random mistakes: every text gives a scene or an Error of one line, within
// bounded memory. BROMWICH_FUZZ=N sets the number of mutations; scripts/fuzz runs many.

#include "core/base/error.hpp"
#include "files/expression.hpp"
#include "files/number_files.hpp"
#include "files/scene_file.hpp"

#include <gtest/gtest.h>

#include <sys/resource.h>
#include <unistd.h>

#include <algorithm>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <random>
#include <string>
#include <vector>

#if defined(__SANITIZE_ADDRESS__) || defined(__SANITIZE_THREAD__)
#define BROMWICH_SANITIZED 1
#endif

namespace bromwich {
namespace {

namespace fs = std::filesystem;

// BROMWICH_FUZZ_SEED, from which other mutations follow; default 0.
unsigned long long seed_of(unsigned long long test) {
  const char* wanted = std::getenv("BROMWICH_FUZZ_SEED");
  return test + (wanted ? 1000 * std::strtoull(wanted, nullptr, 10) : 0);
}

long mutations(long otherwise) {
  const char* wanted = std::getenv("BROMWICH_FUZZ");
  return wanted ? std::atol(wanted) : otherwise;
}

const std::vector<std::string> words{"0",
                                     "1",
                                     "-1",
                                     "2.5",
                                     "1e308",
                                     "-1e308",
                                     "1e-320",
                                     "nan",
                                     "inf",
                                     "-inf",
                                     "1e999",
                                     "99999999999",
                                     "9999999",
                                     "4096",
                                     "16777216",
                                     "1e7",
                                     "0x1F",
                                     "t",
                                     "pi",
                                     "T",
                                     "sin(",
                                     "max(",
                                     "mod(t,1e-3)",
                                     "sign(sin(2*pi*50*t))",
                                     "floor(t/0.1)",
                                     "abs(",
                                     "min()",
                                     "t>0.3",
                                     "t<0.2 ? 1 : 2",
                                     "?",
                                     ":",
                                     "&&",
                                     "||",
                                     "==",
                                     "=",
                                     "!",
                                     "^",
                                     "--",
                                     "(",
                                     ")",
                                     ",",
                                     ",,",
                                     "[",
                                     "]",
                                     "[[",
                                     "]]",
                                     "\"",
                                     "'",
                                     "\"\"\"",
                                     "#",
                                     "\n",
                                     "\r\n",
                                     "\t",
                                     " ",
                                     "%",
                                     "%%MatrixMarket matrix coordinate real general",
                                     "%%MatrixMarket matrix array real symmetric",
                                     "10000000 10000000 1",
                                     "1 1 1",
                                     "t,f0",
                                     "t,g0",
                                     ".csv",
                                     ".mtx",
                                     "\"A.mtx\"",
                                     "\"f.csv\"",
                                     "\"none.mtx\"",
                                     "\"/dev/zero.csv\"",
                                     "\".\"",
                                     "[time]",
                                     "[dynamics]",
                                     "[relay]",
                                     "[port]",
                                     "[boundary]",
                                     "[free]",
                                     "[exact]",
                                     "[reference]",
                                     "[quantity]",
                                     "[output]",
                                     "T = ",
                                     "steps = ",
                                     "jumps = [0.1, 0.5]",
                                     "x0 = ",
                                     "A = ",
                                     "true",
                                     "1979-05-27",
                                     "{a = 1}",
                                     "\xff",
                                     "\xc3\xa9",
                                     std::string(1, '\0'),
                                     "\\u0000",
                                     "e",
                                     "E+",
                                     "."};

class Mutator {
 public:
  explicit Mutator(unsigned long long seed) : random_(seed) {}

  std::size_t below(std::size_t count) { return std::uniform_int_distribution<std::size_t>(0, count - 1)(random_); }

  std::string operator()(std::string text, const std::string& other) {
    for (std::size_t count = 1 + below(4); count > 0; --count) once(text, other);
    return text;
  }

 private:
  void once(std::string& text, const std::string& other) {
    const std::size_t place = below(text.size() + 1), length = std::min(below(20), text.size() - place);
    switch (below(9)) {
      case 0:
        if (place < text.size()) text[place] = char(below(256));
        break;
      case 1:
        text.erase(place, length);
        break;
      case 2:
        text.insert(place, words[below(words.size())]);
        break;
      case 3:
        text.replace(place, length, words[below(words.size())]);
        break;
      case 4:
        text.insert(below(text.size() + 1), std::string(text, place, length));
        break;
      case 5:
        number(text, place);
        break;
      case 6:
        line(text, place);
        break;
      case 7: {
        const std::size_t from = below(other.size() + 1);
        text.insert(place, other, from, below(60));
        break;
      }
      default:
        if (below(4) == 0) text.resize(place);
    }
  }

  /// Replaces the next number by another one.
  void number(std::string& text, std::size_t place) {
    const std::size_t begin = text.find_first_of("0123456789", place);
    if (begin == std::string::npos) return;
    const std::size_t end = std::min(text.find_first_not_of("0123456789.eE", begin), text.size());
    text.replace(begin, end - begin, words[below(17)]);
  }

  /// Removes or repeats a line.
  void line(std::string& text, std::size_t place) {
    const std::size_t begin = text.rfind('\n', place) == std::string::npos ? 0 : text.rfind('\n', place) + 1;
    const std::size_t end = std::min(text.find('\n', place), text.size());
    const std::string found = text.substr(std::min(begin, end), end - std::min(begin, end)) + "\n";
    if (below(2) == 0)
      text.erase(std::min(begin, end), found.size());
    else
      text.insert(std::min(begin, end), found);
  }

  std::mt19937_64 random_;
};

/// While it lives, the process can allocate at most this much more address space.
class LimitedMemory {
 public:
  explicit LimitedMemory(rlim_t bytes) {
    ::getrlimit(RLIMIT_AS, &before_);
#ifndef BROMWICH_SANITIZED
    std::size_t pages = 0;
    std::ifstream("/proc/self/statm") >> pages;
    rlimit limit = before_;
    limit.rlim_cur = std::min(before_.rlim_max, rlim_t(pages) * rlim_t(::sysconf(_SC_PAGE_SIZE)) + bytes);
    if (pages > 0) ::setrlimit(RLIMIT_AS, &limit);
#else
    static_cast<void>(bytes);
#endif
  }
  ~LimitedMemory() { ::setrlimit(RLIMIT_AS, &before_); }
  LimitedMemory(const LimitedMemory&) = delete;
  LimitedMemory& operator=(const LimitedMemory&) = delete;

 private:
  rlimit before_{};
};

/// Runs `read`; 1 if it accepts the text, 0 if it refuses it in one line. Everything else fails the test.
template <class Read>
int outcome(const std::string& text, const Read& read) {
  try {
    read();
    return 1;
  } catch (const Error& error) {
    const std::string line = error.what();
    EXPECT_TRUE(line.find('\n') == std::string::npos && line.find("; ") != std::string::npos) << line << "\n" << text;
  } catch (const std::exception& error) {
    ADD_FAILURE() << error.what() << " from\n" << text;
  } catch (...) {
    ADD_FAILURE() << "an unknown exception from\n" << text;
  }
  return 0;
}

std::string content(const fs::path& path) {
  std::ifstream file(path, std::ios::binary);
  return {std::istreambuf_iterator<char>(file), {}};
}

std::vector<std::string> scenes() {
  std::vector<fs::path> paths;
  for (const auto& entry : fs::directory_iterator(BROMWICH_EXAMPLES))
    if (entry.path().extension() == ".toml" && entry.file_size() < 20'000) paths.push_back(entry.path());
  std::sort(paths.begin(), paths.end());
  std::vector<std::string> texts{
      "[dynamics]\nA = \"A.mtx\"\nB = [[1], [0]]\nf = \"f.csv\"\nx0 = [0, 1]\n[complementarity]\nN = [[1, 0]]\nM = "
      "[[1]]\ng = [\"mod(t, 0.25) < 0.1 ? 1 : -abs(sin(2*pi*t))\"]\n[time]\nT = 1\nsteps = 10\njumps = [0.5]\n"};
  for (const fs::path& path : paths) texts.push_back(content(path));
  return texts;
}

TEST(Fuzz, ScenesAndTheirFiles) {
  const fs::path folder = fs::temp_directory_path() / ("bromwich_fuzz_" + std::to_string(::getpid()));
  fs::create_directories(folder);
  const std::string A = "%%MatrixMarket matrix coordinate real general\n2 2 3\n1 1 -1\n1 2 1\n2 2 -2\n";
  const std::string f = "t,f0,f1\n0,0,1\n0.5,1,0\n0.5,2,0\n1,0,0\n";
  const std::vector<std::string> seeds = scenes();
  const LimitedMemory limited(rlim_t(2) << 30);
  Mutator mutate(seed_of(1));
  long taken = 0;
  const long count = mutations(2000);
  for (long i = 0; i < count; ++i) {
    // Every third text has the table and the matrix, one of them with mistakes.
    const bool with_files = i % 3 == 0;
    if (with_files) {
      const bool table = mutate.below(2) == 0;
      std::ofstream(folder / "f.csv", std::ios::binary) << (table ? mutate(f, A) : f);
      std::ofstream(folder / "A.mtx", std::ios::binary) << (table ? A : mutate(A, f));
    }
    const std::string& seed = with_files ? seeds[0] : seeds[mutate.below(seeds.size())];
    const std::string text = with_files && i % 2 == 0 ? seed : mutate(seed, seeds[mutate.below(seeds.size())]);
    taken += outcome(text, [&] { parse_scene(text, "fuzz.toml", folder).scene.validate(); });
  }
  fs::remove_all(folder);
  EXPECT_GT(taken, count / 50);          // mutations are small enough to keep some scenes valid,
  EXPECT_LT(taken, count - count / 50);  // and large enough to break others
}

TEST(Fuzz, MatricesAndTables) {
  const std::vector<std::string> seeds{
      "%%MatrixMarket matrix coordinate real symmetric\n% c\n3 3 4\n1 1 2\n2 2 2\n3 3 2.5\n3 1 -1e-3\n",
      "%%MatrixMarket matrix array integer skew-symmetric\n3 3\n1\n2\n3\n",
      "%%MatrixMarket matrix coordinate pattern general\n4 2 3\n1 1\n3 2\n4 1\n",
      "t,f0,f1\n0,1,2\n0.25,1,2\n0.25,3,4\n1,0,0\n", "1,2,3\n4,5,6\n# comment\n7,8,9\n"};
  const LimitedMemory limited(rlim_t(2) << 30);
  Mutator mutate(seed_of(2));
  for (long i = 0; i < mutations(2000); ++i) {
    const std::string text = mutate(seeds[mutate.below(seeds.size())], seeds[mutate.below(seeds.size())]);
    outcome(text, [&] { read_matrix_market(text, "A.mtx"); });
    outcome(text, [&] { read_number_table(text, "A.csv"); });
    outcome(text, [&] {
      const TimeTable table = read_time_table(text, "f.csv", 'f');
      require_times_until(table, 1);
      kinks(table, 1);
    });
  }
}

TEST(Fuzz, Expressions) {
  const std::vector<std::string> seeds{
      "max(sin(2*pi*t), 0)",
      "mod(t, 0.1) < 0.03 ? 5 : -2^-t",
      "(t > 0.2 && t <= 0.4) * exp(-R*t) || 0",
      "abs(t-0.5)/(1+t^2) - floor(10*t)/min(R, 2, t+1)",
      "atan2(sin(t), cos(t)) + round(-3.5e-1)",
      "pulse(t, 0, 5, 0.1, 0.01, 0.02, 0.3, 1) - pwl(mod(t, 2), 0, 1, 0.5, 2, 0.5, 0, 1, R) * pulse(t, 0.2, 0.1)"};
  const LimitedMemory limited(rlim_t(2) << 30);
  Expressions expressions;
  expressions.define("R", 3, "here");
  Mutator mutate(seed_of(3));
  long taken = 0;
  for (long i = 0; i < mutations(2000); ++i) {
    const std::string text = mutate(seeds[mutate.below(seeds.size())], seeds[mutate.below(seeds.size())]);
    taken += outcome(text, [&] {
      const std::string full = expressions.in_full(text, "here");
      const TimeFunction function = expressions.in_time({full, "t", full});
      Vector value(3);
      function(0.3, value);
      EXPECT_EQ(value[1], 0.3);
      // Read by muParser alone if it is shorter; the formula must mean the same.
      const SwitchTimes times = expressions.switch_times({full}, 1);
      EXPECT_TRUE(std::is_sorted(times.times.begin(), times.times.end()));
      const Formula formula = read_formula(full, expressions.parameters(), "here");
      const double same = formula(0.3), scale = std::abs(same) + 1;
      EXPECT_TRUE(!(std::abs(value[0] - same) > 1e-9 * scale)) << text << ": " << value[0] << " and " << same;
    });
  }
  EXPECT_GT(taken, 0);
}

}  // namespace
}  // namespace bromwich
