#pragma once
// The rows of all scenes of a batch in arrays of a backend.

#include "../core/seam/backend.hpp"

#include <memory>
#include <vector>

namespace bromwich {

class BatchArrays {
 public:
  /// For scenes of `rows` rows; without states m is 0.
  BatchArrays(Backend&, Index scenes, Index rows, Index n, Index m);

  /// Scenes k .. k + count - 1 get the rows of scenes i .. of these arrays; x: null without states.
  void take(const Array& y, const Array* x, Index i, Index k, Index count);
  bool has(Index k) const { return taken_[std::size_t(k)] != 0; }
  /// The scenes that have not been taken get their rows of the host. Waits.
  void take_others(const RowMatrix& y, const RowMatrix& x);

  const Array& y() const { return *y_; }
  const Array* x() const { return x_.get(); }

 private:
  Backend& backend_;
  Index rows_;
  std::unique_ptr<Array> y_, x_;
  std::vector<char> taken_;
};

}  // namespace bromwich
