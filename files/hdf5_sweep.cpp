#include "core/base/error.hpp"
#include "files/hdf5_chunks.hpp"
#include "files/hdf5_file.hpp"
#include "files/sweep_file.hpp"

#include <hdf5_hl.h>

#include <algorithm>
#include <numeric>
#include <optional>
#include <utility>

namespace bromwich {

using namespace hdf5;

namespace {

constexpr Index chunk_values = 1 << 15;  ///< of one chunk: 256 KiB

class Hdf5Sweep : public SweepFile {
 public:
  Hdf5Sweep(const FileTarget& target, const ResultColumns& columns, const Sweep& sweep, const Vector& t)
      : file_(target, File::Access::create, sweep.scenes()), rows_(t.size()) {
    std::vector<std::int64_t> numbers(static_cast<std::size_t>(sweep.scenes()));
    std::iota(numbers.begin(), numbers.end(), std::int64_t(0));
    scene_ = scale("scene", H5T_STD_I64LE, numbers.size(), numbers.data());
    t_ = scale("t", H5T_IEEE_F64LE, std::size_t(t.size()), t.data());
    for (const std::string& name : sweep.names) {
      if (!coordinates_.empty()) coordinates_ += " ";
      coordinates_ += name;
    }
    for (const std::string& name : sweep.names) parameters_.push_back(variable(name, {}, nullptr));
    residual_ = variable("residual", {}, nullptr);
    numbers.resize(std::size_t(columns.constraints));
    constraint_ = scale("constraint", H5T_STD_I64LE, numbers.size(), numbers.data());
    y_ = variable("y", {hsize_t(rows_), hsize_t(columns.constraints)}, &constraint_);
    if (columns.slack) w_ = variable("w", {hsize_t(rows_), hsize_t(columns.constraints)}, &constraint_);
    add_texts("constraint_name", constraint_names(columns), constraint_);
    if (columns.states.empty()) return;
    const std::vector<std::int64_t> states(columns.states.begin(), columns.states.end());
    state_ = scale("state", H5T_STD_I64LE, states.size(), states.data());
    x_ = variable("x", {hsize_t(rows_), hsize_t(states.size())}, &state_);
    add_texts("state_name", state_names(columns), state_);
  }

  void append(const SweepRows& rows, const HostThreads& threads) override {
    const Index count = rows.residual.size();
    for (Growing& one : parameters_) {
      const Vector values = rows.parameters.col(Index(&one - parameters_.data()));
      one.rows->append(file_, values.data(), count, threads);
    }
    for (const auto& [one, values] : {std::pair(&residual_, rows.residual.data()),
                                      {&y_, rows.y.data()},
                                      {&w_, rows.w.data()},
                                      {&x_, rows.x.data()}})
      if (one->rows) one->rows->append(file_, values, count, threads);
    file_.flush();
  }

  void finish(const std::vector<std::string>& status, const std::vector<std::string>& reason,
              const std::vector<std::string>& warning, const Facts& facts) override {
    for (Growing& one : parameters_) one.rows->finish(file_);
    for (Growing* one : {&residual_, &y_, &w_, &x_})
      if (one->rows) one->rows->finish(file_);
    add_texts("status", status, scene_);
    add_texts("reason", reason, scene_);
    add_texts("warning", warning, scene_);
    set_attributes(file_, file_, facts);
    file_.close();
  }

 private:
  /// Nothing where a file has no such values.
  struct Growing {
    Handle dataset;
    std::optional<ChunkedRows> rows;
  };

  Handle scale(const std::string& name, hid_t type, std::size_t size, const void* values) {
    Handle made = fixed_dataset(file_, file_, name, type, {hsize_t(size)}, values);
    file_.checked(H5DSset_scale(made, name.c_str()));
    return made;
  }

  // One value, or rows, per scene.
  Growing variable(const std::string& name, const Shape& shape, Handle* last) {
    Index width = 1;
    for (const hsize_t length : shape) width *= std::max<Index>(1, Index(length));
    Handle made = growing_dataset(file_, file_, name, H5T_IEEE_F64LE, shape,
                                  std::clamp<Index>(chunk_values / width, 1, chunk_values));
    file_.checked(H5DSattach_scale(made, scene_, 0));
    if (!shape.empty()) {
      file_.checked(H5DSattach_scale(made, t_, 1));
      file_.checked(H5DSattach_scale(made, *last, 2));
      set_attribute(file_, made, "coordinates", coordinates_);
    }
    ChunkedRows rows(file_, made);
    return {std::move(made), std::move(rows)};
  }

  void add_texts(const std::string& name, const std::vector<std::string>& texts, const Handle& of) {
    const Handle made = text_dataset(file_, file_, name, texts);
    file_.checked(H5DSattach_scale(made, of, 0));
  }

  File file_;
  Index rows_;
  std::string coordinates_;
  Handle scene_, t_, constraint_, state_;
  Growing residual_, y_, w_, x_;
  std::vector<Growing> parameters_;
};

}  // namespace

std::unique_ptr<SweepFile> create_sweep_hdf5(const FileTarget& target, const ResultColumns& columns, const Sweep& sweep,
                                             const Vector& t) {
  return std::make_unique<Hdf5Sweep>(target, columns, sweep, t);
}

}  // namespace bromwich
