// Results as NPZ: a zip archive of NumPy arrays,
// https://numpy.org/doc/stable/reference/generated/numpy.lib.format.html. The arrays have the names of the HDF5 layout,
// the facts are arrays of no dimension named attribute_NAME.

#include "core/base/error.hpp"
#include "files/result_file.hpp"

#include <minizip/zip.h>

#include <algorithm>
#include <bit>
#include <cstring>

namespace bromwich {

static_assert(std::endian::native == std::endian::little, "arrays are written as they lie in memory");

namespace {

constexpr int deflate_level = 1;               ///< as for HDF5: higher levels cost time and save little
constexpr std::size_t block_bytes = 16 << 20;  ///< handed to the library at once

// The archive goes into a file that is open already.
voidpf same_file(voidpf file, const void* /*name*/, int /*mode*/) { return file; }
uLong write_bytes(voidpf /*opaque*/, voidpf file, const void* bytes, uLong size) {
  return uLong(std::fwrite(bytes, 1, size, static_cast<std::FILE*>(file)));
}
ZPOS64_T position(voidpf /*opaque*/, voidpf file) { return ZPOS64_T(::ftello(static_cast<std::FILE*>(file))); }
long seek(voidpf /*opaque*/, voidpf file, ZPOS64_T offset, int origin) {
  const int whence = origin == ZLIB_FILEFUNC_SEEK_CUR   ? SEEK_CUR
                     : origin == ZLIB_FILEFUNC_SEEK_END ? SEEK_END
                                                        : SEEK_SET;
  return ::fseeko(static_cast<std::FILE*>(file), off_t(offset), whence);
}
uLong read_nothing(voidpf /*opaque*/, voidpf /*file*/, void* /*bytes*/, uLong /*size*/) { return 0; }
int leave_open(voidpf /*opaque*/, voidpf /*file*/) { return 0; }
int has_failed(voidpf /*opaque*/, voidpf file) { return std::ferror(static_cast<std::FILE*>(file)); }

class Archive {
 public:
  Archive(const FileTarget& target, std::FILE* file) : target_(target) {
    zlib_filefunc64_def functions{same_file, read_nothing, write_bytes, position, seek, leave_open, has_failed, file};
    zip_ = zipOpen2_64(target.path.c_str(), APPEND_STATUS_CREATE, nullptr, &functions);
    if (!zip_) fail();
  }
  ~Archive() {
    if (zip_) zipClose(zip_, nullptr);
  }
  Archive(const Archive&) = delete;
  Archive& operator=(const Archive&) = delete;

  /// `type` as NumPy writes it ("<f8"), `shape` without brackets ("3, 4").
  void add(const std::string& name, const std::string& type, const std::string& shape, const void* values,
           std::size_t bytes) {
    begin(name, type, shape);
    for (std::size_t done = 0; done < bytes; done += block_bytes)
      write(static_cast<const char*>(values) + done, std::min(block_bytes, bytes - done));
    end();
  }

  void add(const std::string& name, const Eigen::Ref<const RowMatrix>& values) {
    begin(name, "<f8", std::to_string(values.rows()) + ", " + std::to_string(values.cols()));
    const Index step = std::max<Index>(1, Index(block_bytes / sizeof(double)) / std::max<Index>(1, values.cols()));
    for (Index first = 0; first < values.rows(); first += step) {
      const Index count = std::min(step, values.rows() - first);
      if (values.outerStride() == values.cols()) {
        write(values.data() + first * values.cols(), std::size_t(count * values.cols()) * sizeof(double));
        continue;
      }
      const RowMatrix block = values.middleRows(first, count);
      write(block.data(), std::size_t(block.size()) * sizeof(double));
    }
    end();
  }

  void finish() {
    const auto zip = std::exchange(zip_, nullptr);
    if (zipClose(zip, nullptr) != ZIP_OK) fail();
  }

 private:
  void begin(const std::string& name, const std::string& type, const std::string& shape) {
    zip_fileinfo info{};
    info.tmz_date.tm_mday = 1;
    info.tmz_date.tm_year = 1980;  // the first that a zip archive knows
    check(zipOpenNewFileInZip64(zip_, (name + ".npy").c_str(), &info, nullptr, 0, nullptr, 0, nullptr, Z_DEFLATED,
                                deflate_level, 1));
    std::string header = "{'descr': '" + type + "', 'fortran_order': False, 'shape': (" + shape + "), }";
    constexpr std::size_t before = 10, alignment = 64;  // the magic string and the length
    header.append((alignment - (before + header.size() + 1) % alignment) % alignment, ' ');
    header += '\n';
    std::string magic("\x93NUMPY\x01\x00", 8);
    magic += char(header.size() & 0xff);
    magic += char(header.size() >> 8);
    write((magic + header).data(), magic.size() + header.size());
  }
  void write(const void* bytes, std::size_t size) { check(zipWriteInFileInZip(zip_, bytes, unsigned(size))); }
  void end() { check(zipCloseFileInZip(zip_)); }
  void check(int code) {
    if (code != ZIP_OK) fail();
  }
  [[noreturn]] void fail() {
    const std::string why = errno ? std::strerror(errno) : "writing failed";
    throw Error(target_.argument, "'" + target_.path.string() + "' could not be written (" + why + ")",
                "free some space, raise ulimit -f, or choose another folder");
  }

  const FileTarget& target_;
  zipFile zip_ = nullptr;
};

/// UTF-8 as the four-byte characters of NumPy's strings; other bytes are taken as Latin-1.
std::u32string characters(const std::string& text) {
  std::u32string found;
  for (std::size_t i = 0; i < text.size();) {
    const auto first = static_cast<unsigned char>(text[i]);
    const std::size_t length = first < 0x80 ? 1 : first >> 5 == 6 ? 2 : first >> 4 == 14 ? 3 : first >> 3 == 30 ? 4 : 0;
    char32_t value = length <= 1 ? first : first & (0x7fU >> length);
    bool whole = length > 0 && i + length <= text.size();
    for (std::size_t k = 1; whole && k < length; ++k) {
      const auto next = static_cast<unsigned char>(text[i + k]);
      whole = next >> 6 == 2;
      value = value << 6 | (next & 0x3fU);
    }
    found += whole ? value : char32_t(first);
    i += whole ? length : 1;
  }
  return found;
}

/// An array of strings; with one string and no shape, an array of no dimension.
void add_texts(Archive& archive, const std::string& name, const std::vector<std::string>& texts,
               const std::string& shape) {
  std::vector<std::u32string> rows;
  std::size_t width = 1;
  for (const std::string& text : texts) width = std::max(width, rows.emplace_back(characters(text)).size());
  std::u32string all;
  for (std::u32string& row : rows) {
    row.resize(width, U'\0');
    all += row;
  }
  archive.add(name, "<U" + std::to_string(width), shape, all.data(), all.size() * sizeof(char32_t));
}

void add_numbers(Archive& archive, const std::string& name, const std::vector<std::int64_t>& numbers) {
  archive.add(name, "<i8", std::to_string(numbers.size()) + ",", numbers.data(), numbers.size() * sizeof(std::int64_t));
}

void add_fact(Archive& archive, const std::string& name, const Fact& fact) {
  if (const auto* text = std::get_if<std::string>(&fact)) return add_texts(archive, name, {*text}, "");
  if (const auto* number = std::get_if<double>(&fact)) return archive.add(name, "<f8", "", number, sizeof *number);
  const auto& number = std::get<std::int64_t>(fact);
  archive.add(name, "<i8", "", &number, sizeof number);
}

}  // namespace

bool npz_available() { return true; }

void write_npz(const FileTarget& target, const ResultColumns& columns, const ResultRows& rows,
               const std::vector<TimeSeries>& series, const Facts& facts, std::FILE* file) {
  errno = 0;
  Archive archive(target, file);
  const auto add_vector = [&](const std::string& name, const double* values, Index count) {
    archive.add(name, "<f8", std::to_string(count) + ",", values, std::size_t(count) * sizeof(double));
  };
  add_vector("t", rows.t.data(), rows.t.size());
  for (const TimeSeries& one : series) add_vector(one.name, one.values.data(), one.values.size());
  std::vector<std::int64_t> numbers;
  for (Index i = 0; i < columns.constraints; ++i) numbers.push_back(i);
  if (columns.constraints > 0) {
    archive.add("y", rows.y);
    if (columns.slack) archive.add("w", rows.w);
    add_numbers(archive, "constraint", numbers);
    add_texts(archive, "constraint_name", constraint_names(columns), std::to_string(columns.constraints) + ",");
  }
  if (!columns.states.empty()) {
    archive.add("x", rows.x);
    add_numbers(archive, "state", {columns.states.begin(), columns.states.end()});
    add_texts(archive, "state_name", state_names(columns), std::to_string(columns.states.size()) + ",");
  }
  for (const auto& [name, fact] : facts) add_fact(archive, "attribute_" + name, fact);
  archive.finish();
}

}  // namespace bromwich
