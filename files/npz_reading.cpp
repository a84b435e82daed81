// Reads the layout of npz.cpp, which is also that of numpy.savez.

#include "core/base/error.hpp"
#include "files/stored_result.hpp"
#include "files/words.hpp"

#include <minizip/unzip.h>

#include <cstring>
#include <map>

namespace bromwich {

namespace {

/// An array of an archive: what its header says, and its bytes.
struct Stored {
  std::string type;  ///< as NumPy writes it: "<f8"
  std::vector<Index> shape;
  std::string bytes;

  Index count() const {
    Index all = 1;
    for (const Index size : shape) all *= size;
    return all;
  }
};

class Reading {
 public:
  explicit Reading(const FileTarget& target) : target_(target), zip_(unzOpen64(target.path.c_str())) {
    if (std::error_code none; !std::filesystem::is_regular_file(target.path, none)) refuse("is no file");
    if (!zip_) refuse("is no archive of arrays");
  }
  ~Reading() { unzClose(zip_); }
  Reading(const Reading&) = delete;
  Reading& operator=(const Reading&) = delete;

  std::map<std::string, Stored> arrays() {
    std::map<std::string, Stored> found;
    for (int code = unzGoToFirstFile(zip_); code == UNZ_OK; code = unzGoToNextFile(zip_)) {
      char name[256] = {};
      unz_file_info64 info{};
      check(unzGetCurrentFileInfo64(zip_, &info, name, sizeof name - 1, nullptr, 0, nullptr, 0));
      std::string key(name);
      if (key.size() > 4 && key.ends_with(".npy")) found[key.substr(0, key.size() - 4)] = array(info.uncompressed_size);
    }
    return found;
  }

  [[noreturn]] void refuse(const std::string& what) const {
    throw Error(target_.argument, "'" + target_.path.string() + "' " + what,
                "give a file that 'bromwich solve --out' has written");
  }

 private:
  /// The bytes as they come: what the archive says of their number may be anything.
  Stored array(std::uint64_t size) {
    check(unzOpenCurrentFile(zip_));
    std::string bytes, part(1 << 16, '\0');
    for (int got = 1; got > 0 && bytes.size() <= size;) {
      got = unzReadCurrentFile(zip_, part.data(), unsigned(part.size()));
      if (got < 0) refuse("could not be read to its end");
      bytes.append(part, 0, std::size_t(got));
    }
    if (bytes.size() != size) refuse("has an entry of another length than it says");
    check(unzCloseCurrentFile(zip_));
    return parsed(bytes);
  }

  Stored parsed(const std::string& bytes) const {
    if (bytes.size() < 10 || bytes.compare(0, 6, "\x93NUMPY") != 0) refuse("has an entry that is no array");
    const auto byte = [&](std::size_t i) { return std::size_t(static_cast<unsigned char>(bytes[i])); };
    const bool first = bytes[6] == 1;
    const std::size_t begin = first ? 10 : 12;
    if (bytes.size() < begin) refuse("has an array without values");
    const std::size_t length = byte(8) + (byte(9) << 8) + (first ? 0 : (byte(10) << 16) + (byte(11) << 24));
    if (bytes.size() < begin + length) refuse("has an array without values");
    const std::string header = bytes.substr(begin, length);
    Stored stored{between(header, "'descr': '", "'"), {}, bytes.substr(begin + length)};
    if (header.find("'fortran_order': False") == std::string::npos) refuse("has an array in column order");
    for (const std::string& word : split_list(between(header, "'shape': (", ")"))) take_extent(word, stored);
    return stored;
  }

  /// One number of a shape; "" behind the last comma. No array has more entries than bytes.
  void take_extent(const std::string& word, Stored& stored) const {
    const std::size_t digit = word.find_first_not_of(' ');
    if (digit == std::string::npos) return;
    const auto size = parse_integer(word.substr(digit));
    const Index before = stored.count();
    if (!size || *size < 0 || (before > 0 && *size > Index(stored.bytes.size()) / before))
      refuse("has an array of another shape than it says");
    stored.shape.push_back(Index(*size));
  }

  std::string between(const std::string& text, const std::string& before, const std::string& after) const {
    const std::size_t at = text.find(before);
    if (at == std::string::npos) refuse("has an array with an unknown header");
    const std::size_t begin = at + before.size();
    return text.substr(begin, text.find(after, begin) - begin);
  }

  void check(int code) const {
    if (code != UNZ_OK) refuse("could not be read");
  }

  const FileTarget& target_;
  unzFile zip_;
};

/// Four-byte characters of NumPy as UTF-8.
std::vector<std::string> texts(const Stored& stored) {
  std::vector<std::string> found;
  if (!stored.type.starts_with("<U")) return found;
  const auto characters = parse_integer(stored.type.substr(2));
  const Index count = stored.count(), most = Index(stored.bytes.size()) / 4;
  if (!characters || *characters < 1 || (count > 0 && *characters > most / count)) return found;
  const auto width = std::size_t(*characters);
  for (std::size_t i = 0; i < std::size_t(count); ++i) {
    std::string word;
    for (std::size_t k = 0; k < width; ++k) {
      std::uint32_t c = 0;
      std::memcpy(&c, stored.bytes.data() + 4 * (i * width + k), 4);
      if (c == 0) break;
      if (c < 0x80) {
        word += char(c);
        continue;
      }
      const int more = c < 0x800 ? 1 : c < 0x10000 ? 2 : 3;
      word += char((0xf00 >> more & 0xff) | int(c >> (6 * more)));
      for (int part = more - 1; part >= 0; --part) word += char(0x80 | int(c >> (6 * part) & 0x3f));
    }
    found.push_back(std::move(word));
  }
  return found;
}

RowMatrix numbers(const Reading& reading, const std::map<std::string, Stored>& arrays, const std::string& name) {
  const auto at = arrays.find(name);
  if (at == arrays.end()) return {};
  const Stored& stored = at->second;
  if (stored.type != "<f8" || stored.shape.empty() || stored.shape.size() > 2 ||
      stored.bytes.size() / sizeof(double) < std::size_t(stored.count()))
    reading.refuse("has no table of float64 named " + name);
  RowMatrix values(stored.shape[0], stored.shape.size() == 2 ? stored.shape[1] : 1);
  std::memcpy(values.data(), stored.bytes.data(), sizeof(double) * std::size_t(values.size()));
  return values;
}

Facts facts_of(const std::map<std::string, Stored>& arrays) {
  constexpr std::string_view prefix = "attribute_";
  Facts facts;
  for (const auto& [key, stored] : arrays) {
    if (!key.starts_with(prefix) || !stored.shape.empty()) continue;
    const std::string name = key.substr(prefix.size());
    if (const auto words = texts(stored); !words.empty()) {
      facts.emplace_back(name, words.front());
    } else if (stored.type == "<f8" && stored.bytes.size() >= sizeof(double)) {
      double value = 0;
      std::memcpy(&value, stored.bytes.data(), sizeof value);
      facts.emplace_back(name, value);
    } else if (stored.type == "<i8" && stored.bytes.size() >= sizeof(std::int64_t)) {
      std::int64_t value = 0;
      std::memcpy(&value, stored.bytes.data(), sizeof value);
      facts.emplace_back(name, value);
    }
  }
  return facts;
}

}  // namespace

StoredResult read_npz(const FileTarget& target) {
  Reading reading(target);
  const std::map<std::string, Stored> arrays = reading.arrays();
  if (!arrays.contains("t")) reading.refuse("has no array t");
  StoredResult stored;
  const RowMatrix t = numbers(reading, arrays, "t");
  if (t.cols() != 1) reading.refuse("has several columns in its array t");
  stored.t = t.col(0);
  stored.y = numbers(reading, arrays, "y");
  stored.w = numbers(reading, arrays, "w");
  stored.x = numbers(reading, arrays, "x");
  for (const auto& [name, into] :
       {std::pair("constraint_name", &stored.constraint_names), {"state_name", &stored.state_names}})
    if (arrays.contains(name)) *into = texts(arrays.at(name));
  for (const auto& [name, array] : arrays)
    if (name != "t" && array.type == "<f8" && array.shape == std::vector<Index>{stored.t.size()})
      stored.others.push_back({name, "", numbers(reading, arrays, name).col(0)});
  stored.facts = facts_of(arrays);
  require_rows(target, stored);
  return stored;
}

}  // namespace bromwich
