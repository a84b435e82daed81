// Transforms between values at the points of a face and the coefficients of its modes, direction after direction.

#include "cpu/folded_sine.hpp"
#include "cpu/parts.hpp"

#include <algorithm>
#include <memory>
#include <optional>
#include <utility>
#include <vector>

namespace bromwich::cpu {

namespace {

/// Products with the matrices of all directions, one after the other: Σ n_d multiplications a point for folded sine
/// matrices, 2 Σ n_d for others.
class FaceProducts final : public VectorTransform {
 public:
  /// Up to `together` faces at a time.
  FaceProducts(const FaceBasis& basis, Way way, Index together) : points_(basis.points()) {
    Index inner = points_;
    for (const LineBasis& line : basis.directions()) {
      const Index n = line.points;
      inner /= n;
      Direction d{{}, {}, n, points_ / (n * inner), inner};
      if (!line.V)
        d.sine.emplace(n);
      else if (way == Way::to_modes)
        d.P = *line.V;
      else
        d.P = line.V->transpose();
      directions_.push_back(std::move(d));
    }
    for (Vector* buffer : {&folded_, &product_}) buffer->resize(points_ * together);
  }

  std::unique_ptr<VectorTransform> another() const override { return std::make_unique<FaceProducts>(*this); }

  void apply(const double* in, double* out) override { apply(in, out, 1); }
  void apply(const double* in, double* out, Index faces) {
    for (const Direction& d : directions_) {
      const Index outer = d.outer * faces, size = d.n * d.inner;
      for (Index o = 0; o < (d.inner > 1 ? outer : 0); ++o) columns(d, in + o * size, out + o * size);
      if (d.inner == 1) rows(d, outer, in, out);
      in = out;
    }
  }

  std::size_t bytes() const {
    std::size_t values = std::size_t(2 * product_.size());
    for (const Direction& d : directions_)
      values += std::size_t(d.sine ? d.sine->E.size() + d.sine->O.size() : d.P.size());
    return values * sizeof(double);
  }

 private:
  struct Direction {
    std::optional<FoldedSine> sine;
    RowMatrix P;            ///< instead: n x n, rows are multiplied by it
    Index n, outer, inner;  ///< points: its own, of the slower and of the faster directions
  };
  using Rows = Eigen::Map<RowMatrix>;

  // out = P^T in for n x inner values; `out` may be `in`.
  void columns(const Direction& d, const double* in, double* out) {
    if (!d.sine) {
      Rows product(product_.data(), d.n, d.inner);
      product.noalias() = d.P.transpose() * Eigen::Map<const RowMatrix>(in, d.n, d.inner);
      Rows(out, d.n, d.inner) = product;
      return;
    }
    const FoldedSine& s = *d.sine;
    const Eigen::Map<const RowMatrix> x(in, s.n, d.inner);
    Rows e(folded_.data(), s.even, d.inner), o(folded_.data() + s.even * d.inner, s.odd, d.inner);
    for (Index i = 0; i < s.odd; ++i) {
      e.row(i) = x.row(i) + x.row(s.n - 1 - i);
      o.row(i) = x.row(i) - x.row(s.n - 1 - i);
    }
    if (s.even > s.odd) e.row(s.odd) = x.row(s.odd);
    Rows even(product_.data(), s.even, d.inner), odd(product_.data() + s.even * d.inner, s.odd, d.inner);
    even.noalias() = s.E.transpose() * e;
    if (s.odd > 0) odd.noalias() = s.O.transpose() * o;
    Rows y(out, s.n, d.inner);
    for (Index q = 0; q < s.even; ++q) y.row(2 * q) = even.row(q);
    for (Index q = 0; q < s.odd; ++q) y.row(2 * q + 1) = odd.row(q);
  }

  // The same for the fastest direction: in is outer x n, out = in P.
  void rows(const Direction& d, Index outer, const double* in, double* out) {
    if (!d.sine) {
      Rows product(product_.data(), outer, d.n);
      product.noalias() = Eigen::Map<const RowMatrix>(in, outer, d.n) * d.P;
      Rows(out, outer, d.n) = product;
      return;
    }
    const FoldedSine& s = *d.sine;
    Rows e(folded_.data(), outer, s.even), o(folded_.data() + outer * s.even, outer, s.odd);
    for (Index j = 0; j < outer; ++j) s.fold(in + j * s.n, e.row(j).data(), o.data() + j * s.odd);
    Rows even(product_.data(), outer, s.even), odd(product_.data() + outer * s.even, outer, s.odd);
    even.noalias() = e * s.E;
    if (s.odd > 0) odd.noalias() = o * s.O;
    for (Index j = 0; j < outer; ++j) {
      double* to = out + j * s.n;
      for (Index q = 0; q < s.even; ++q) to[2 * q] = even(j, q);
      for (Index q = 0; q < s.odd; ++q) to[2 * q + 1] = odd(j, q);
    }
  }

  Index points_;
  std::vector<Direction> directions_;
  Vector folded_, product_;
};

class FaceTransform final : public RowTransform {
  static constexpr Index parallel_size = 1 << 12;
  static constexpr Index most_together = 32;  ///< lines that one product takes

 public:
  FaceTransform(const FaceBasis& basis, Index rows, Way way, Team& team)
      : n_(basis.points()), together_(basis.size() == 1 ? most_together : 1), team_(team) {
    const int used = rows * n_ > parallel_size ? team.threads() : 1;
    products_.emplace_back(basis, way, together_);
    for (int t = 1; t < used; ++t) products_.push_back(products_[0]);
    sums_.resize(used * together_, n_);
  }

  void apply(const Array& in, const Array* add, Array& out, Index first) override {
    const RowMatrix& x = host(in);
    const RowMatrix* a = add ? &host(*add) : nullptr;
    RowMatrix& y = host(out);
    const Index count = (x.rows() - first + together_ - 1) / together_;
    team_.share(count, products_.size() > 1, [&](Index block, int thread) {
      const FlushDenormals flush;
      const Index j = first + block * together_, size = std::min(together_, x.rows() - j);
      auto rows = sums_.middleRows(thread * together_, size);
      products_[std::size_t(thread)].apply(x.row(j).data(), a ? rows.data() : y.row(j).data(), size);
      if (a) y.middleRows(j, size) = a->middleRows(j, size) + rows;
    });
  }

  std::size_t bytes() const override {
    return products_.size() * products_[0].bytes() + sizeof(double) * std::size_t(sums_.size());
  }

 private:
  Index n_, together_;
  std::vector<FaceProducts> products_;
  RowMatrix sums_;
  Team& team_;
};

}  // namespace

std::unique_ptr<VectorTransform> make_vector_transform(const FaceBasis& basis, Way way) {
  if (basis.size() == 1 && basis.is_sine()) return make_vector_sine(basis.points());
  return std::make_unique<FaceProducts>(basis, way, 1);
}

std::unique_ptr<RowTransform> make_face_transform(const FaceBasis& basis, Index rows, Way way, Team& team) {
  return std::make_unique<FaceTransform>(basis, rows, way, team);
}

}  // namespace bromwich::cpu
