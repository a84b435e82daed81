#include "app/scene_blocks.hpp"

#include "core/base/error.hpp"

#include <fmt/format.h>

#include <unistd.h>

#include <cmath>
#include <fstream>
#include <functional>
#include <sstream>
#include <type_traits>
#include <utility>

namespace bromwich::app {

namespace fs = std::filesystem;

namespace {

// Values one after the other, sizes before them, as this machine stores them.
class Writer {
 public:
  explicit Writer(std::ostream& out) : out_(out) {}
  template <class T>
  void operator()(const T& value) {
    if constexpr (std::is_trivially_copyable_v<T>) {
      out_.write(reinterpret_cast<const char*>(&value), sizeof value);
    } else if constexpr (std::is_same_v<T, std::string>) {
      (*this)(value.size());
      out_.write(value.data(), std::streamsize(value.size()));
    } else if constexpr (requires { value.cols(); }) {
      (*this)(value.rows());
      (*this)(value.cols());
      out_.write(reinterpret_cast<const char*>(value.data()), std::streamsize(sizeof(double)) * value.size());
    } else {  // texts: one after the other, each with a zero at its end
      std::string all;
      for (const std::string& one : value) all.append(one).push_back('\0');
      (*this)(all);
    }
  }

 private:
  std::ostream& out_;
};

class Reader {
 public:
  explicit Reader(std::istream& in) : in_(in) {}
  template <class T>
  void operator()(T& value) {
    if constexpr (std::is_trivially_copyable_v<T>) {
      in_.read(reinterpret_cast<char*>(&value), sizeof value);
    } else if constexpr (std::is_same_v<T, std::string>) {
      value.resize(size());
      in_.read(value.data(), std::streamsize(value.size()));
    } else if constexpr (requires { value.cols(); }) {
      Index rows = 0, cols = 0;
      (*this)(rows);
      (*this)(cols);
      value.resize(rows, cols);
      in_.read(reinterpret_cast<char*>(value.data()), std::streamsize(sizeof(double)) * value.size());
    } else {
      std::string all;
      (*this)(all);
      for (std::size_t begin = 0, end = all.find('\0'); end != std::string::npos; end = all.find('\0', begin)) {
        value.push_back(all.substr(begin, end - begin));
        begin = end + 1;
      }
    }
  }

 private:
  std::size_t size() {
    std::size_t count = 0;
    (*this)(count);
    return in_ ? count : 0;
  }
  std::istream& in_;
};

template <class Archive, class Block>
void each_member(Archive&& archive, Block& block) {
  archive(block.first);
  archive(block.count);
  archive(block.status);
  archive(block.reason);
  archive(block.warning);
  archive(block.rows);
  archive(block.residual);
  archive(block.y);
  archive(block.w);
  archive(block.x);
  archive(block.in_lanes);
  archive(block.seconds_read);
  archive(block.seconds);
}

std::string text_of(const fs::path& path) {
  std::ifstream in(path, std::ios::binary);
  std::ostringstream text;
  text << in.rdbuf();
  return text.str();
}

// A file is renamed when it is complete.
void write_whole(const fs::path& path, const std::function<void(std::ostream&)>& fill) {
  const fs::path unfinished = fmt::format("{}.{}.tmp", path.string(), ::getpid());
  {
    std::ofstream out(unfinished, std::ios::binary);
    fill(out);
    out.flush();
    if (out) {
      fs::rename(unfinished, path);
      return;
    }
  }
  std::error_code none;
  fs::remove(unfinished, none);
  throw Error("--out", fmt::format("'{}' could not be written", path.string()), "free some space");
}

}  // namespace

void keep_arrays(SceneBlock& block, BatchResult result, const std::vector<Index>& places, ArraySizes sizes) {
  if (result.scenes == block.count) {
    block.residual = std::move(result.residual);
    block.y = std::move(result.y), block.w = std::move(result.w), block.x = std::move(result.x);
    return;
  }
  const Index rows = sizes.rows, all = block.count * rows;
  block.residual = Vector::Constant(block.count, NAN);
  block.y = RowMatrix::Constant(all, sizes.constraints, NAN), block.w = block.y;
  block.x = RowMatrix::Constant(all, sizes.states, NAN);
  for (std::size_t i = 0; i < places.size(); ++i) {
    if (places[i] < 0) continue;
    const Index to = Index(i) * rows;
    block.residual[Index(i)] = result.residual[places[i]];
    block.y.middleRows(to, rows) = result.of(result.y, places[i]);
    block.w.middleRows(to, rows) = result.of(result.w, places[i]);
    if (sizes.states > 0) block.x.middleRows(to, rows) = result.of(result.x, places[i]);
  }
}

BlockFolder::BlockFolder(fs::path folder, std::string sweep) : folder_(std::move(folder)), sweep_(std::move(sweep)) {}

void BlockFolder::open(bool again) const {
  const fs::path about = folder_ / "sweep.txt";
  if (again) {
    if (!fs::is_regular_file(about))
      throw Error("--restart", fmt::format("'{}' is no folder of a sweep", folder_.string()),
                  "name the folder FILE.parts that the run before has left");
    if (text_of(about) != sweep_)
      throw Error("--restart", fmt::format("'{}' is of another sweep, or of other options", folder_.string()),
                  "restart with the file and options of that run, or begin anew without --restart");
    return;
  }
  std::error_code failure;
  fs::remove_all(folder_, failure);
  if (!fs::create_directory(folder_, failure))
    throw Error("--out", fmt::format("'{}' cannot be made ({})", folder_.string(), failure.message()),
                "choose another folder");
  write_whole(about, [this](std::ostream& out) { out << sweep_; });
}

fs::path BlockFolder::name_of(Index first) const { return folder_ / fmt::format("{}.block", first); }
bool BlockFolder::has(Index first) const { return fs::exists(name_of(first)); }

void BlockFolder::save(const SceneBlock& block) const {
  write_whole(name_of(block.first), [&](std::ostream& out) { each_member(Writer(out), block); });
}

SceneBlock BlockFolder::load(Index first) const {
  SceneBlock block;
  std::ifstream in(name_of(first), std::ios::binary);
  each_member(Reader(in), block);
  if (!in || block.first != first)
    throw Error("[sweep]", fmt::format("the scenes from {} on are not solved", first),
                fmt::format("go on with --restart {}", folder_.string()));
  return block;
}

void BlockFolder::remove() const {
  std::error_code none;
  fs::remove_all(folder_, none);
}

}  // namespace bromwich::app
