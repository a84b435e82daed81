#pragma once
// Runs the command as a user does. Its path comes from the build (BROMWICH_CLI).

#include <gtest/gtest.h>

#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cstdio>
#include <filesystem>
#include <fstream>
#include <sstream>
#include <string>
#include <vector>

namespace bromwich {

namespace fs = std::filesystem;

struct Outcome {
  int exit_code = -1;
  std::string out, err;
};

inline std::string read(const fs::path& path) {
  std::ifstream file(path, std::ios::binary);
  std::ostringstream text;
  text << file.rdbuf();
  return text.str();
}

/// x' = -x, with a constraint that is never active.
inline const std::string decay = R"toml(
name = "decay"
[parameters]
x0 = 2
[dynamics]
A = [[-1]]
B = [[0]]
x0 = ["x0"]
[complementarity]
N = [[1]]
M = [[1]]
[time]
T = 1
steps = 8
[output]
states = "all"
)toml";

/// A separate folder per test, removed at the end.
class Cli : public testing::Test {
 protected:
  void SetUp() override {
    const auto* info = testing::UnitTest::GetInstance()->current_test_info();
    std::string name = info->name();
    std::replace(name.begin(), name.end(), '/', '_');
    folder_ = fs::temp_directory_path() / ("bromwich_cli_" + name + "_" + std::to_string(::getpid()));
    fs::create_directories(folder_);
  }
  void TearDown() override { fs::remove_all(folder_); }

  /// `arguments` and `before` (a command that starts the binary) are shell text.
  Outcome run(const std::string& arguments, const std::string& before = "") const {
    const fs::path err = folder_ / ".stderr";
    const std::string line =
        "cd '" + folder_.string() + "' && " + before + " '" BROMWICH_CLI "' " + arguments + " 2>'" + err.string() + "'";
    Outcome result;
    std::FILE* pipe = ::popen(line.c_str(), "r");
    if (!pipe) return result;
    std::array<char, 4096> buffer;
    for (std::size_t count; (count = std::fread(buffer.data(), 1, buffer.size(), pipe)) > 0;)
      result.out.append(buffer.data(), count);
    const int status = ::pclose(pipe);
    result.exit_code = WIFEXITED(status) ? WEXITSTATUS(status) : -1;
    result.err = read(err);
    fs::remove(err);
    return result;
  }

  /// Bad input: exit code 2, nothing on standard output, one line on standard error.
  Outcome refused(const std::string& arguments) const {
    Outcome result = run(arguments);
    EXPECT_EQ(result.exit_code, 2) << arguments;
    EXPECT_EQ(result.out, "") << arguments;
    EXPECT_TRUE(result.err.starts_with("bromwich: ")) << arguments << "\n" << result.err;
    EXPECT_EQ(std::count(result.err.begin(), result.err.end(), '\n'), 1) << arguments << "\n" << result.err;
    EXPECT_TRUE(result.err.ends_with('\n')) << arguments;
    return result;
  }

  std::size_t files() const {
    return std::size_t(std::distance(fs::directory_iterator(folder_), fs::directory_iterator{}));
  }

  fs::path folder_;
};

inline std::vector<std::string> split(const std::string& text, char separator) {
  std::vector<std::string> parts;
  std::istringstream stream(text);
  for (std::string part; std::getline(stream, part, separator);) parts.push_back(part);
  return parts;
}

inline bool contains(const std::string& text, const std::string& part) { return text.find(part) != std::string::npos; }

struct BadInput {
  std::string arguments;
  std::vector<std::string> mentions;  ///< the argument, what was found, what to do
};

}  // namespace bromwich
