#pragma once
// The state of a recurrence (core/seam/recurrence.hpp) in a slab of time: its start, its end, and what it adds to v.
// One class for each kind of recurrence, with the same functions.

#include "slab_array.hpp"

#include <memory>
#include <vector>

namespace bromwich {

/// K exponentials for each of n modes, as K n values.
class ModalState {
 public:
  explicit ModalState(const ModalRecurrence& r);

  Index size() const { return K_ * n_; }
  /// z <- the state before row 1 of an array that begins with y_0: of y_0 and x0.
  void start(const double* y0, Eigen::Ref<Vector> z) const;
  /// The part of x0 in it.
  Vector initial() const { return Eigen::Map<const Vector>(initial_.data(), initial_.size()); }
  /// See Convolution::start_from.
  void start_from(const RowMatrix& D);
  /// z <- the state after rows 1 .. rows of y.
  void advance(HostRows& y, Index rows, const HostThreads&, Eigen::Ref<Vector> z) const;
  /// v_j += C E^{j-1} z for rows 1 .. rows. Returns the last row that was changed; 0: none.
  Index add(const Eigen::Ref<const Vector>& z, Index rows, const HostThreads&, HostRows& v) const;
  /// Values of a state that outlive `steps` steps.
  std::vector<Index> lasting(Index steps) const;
  /// E^steps for those values of a state.
  Eigen::DiagonalMatrix<double, Eigen::Dynamic> power(const std::vector<Index>& which, Index steps) const;

 private:
  Index K_, n_;
  struct Bunch;
  template <class Body>
  void in_bunches(const HostThreads&, const Body&) const;

  RowMatrix decay_, output_, start_, initial_;
  std::shared_ptr<const std::vector<Bunch>> bunches_;  ///< of neighbouring modes, ready for vectors
};

/// The recurrence of a rank. Where row 0 is a copy of another rank's row, its part in the state comes by message, x0
/// too, and lag 1 outside of the exponentials is that of any row.
ModalRecurrence of_rank(const ModalRecurrence&, bool first);

/// What ranks before the last one leave to a rank: the values k n + l of a K x n state that outlive the shortest slab
/// between two others, and powers(r, i) = E^d for value i, d the steps from the end of slab r to the beginning of the
/// slab of `rank`. Zero for the rank before, whose whole state comes, and for later ones. Nothing for two ranks.
struct Outliving {
  std::vector<Index> values;
  RowMatrix powers;
};
Outliving outliving(const RowMatrix& decay, const std::vector<Index>& ends, int rank);

/// Rows after which the powers of |E| = `slowest` are forgotten, at most `most`.
Index remembered(double slowest, Index most);

/// m values.
class DenseState {
 public:
  explicit DenseState(const DenseRecurrence& r);

  Index size() const { return r_.decay.rows(); }
  void start(const double* y0, Eigen::Ref<Vector> z) const;
  void advance(HostRows& y, Index rows, const HostThreads&, Eigen::Ref<Vector> end) const;
  Index add(const Eigen::Ref<const Vector>& z, Index rows, const HostThreads&, HostRows& v) const;
  std::vector<Index> lasting(Index steps) const;
  Matrix power(const std::vector<Index>& all, Index steps) const;

 private:
  DenseRecurrence r_;
  Index memory_ = 1;  ///< steps after which nothing is left
};

}  // namespace bromwich
