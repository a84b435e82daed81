#include "core/result/located_solution.hpp"

#include <algorithm>

namespace bromwich {

namespace {

/// n: the largest y of active constraints on a piece; 0 for others.
Vector largest_y(const EventPiece& piece) {
  constexpr int parts = 8;
  Vector largest = Vector::Zero(piece.y.cols());
  for (int k = 0; k <= parts; ++k) {
    const LegendreValues at = legendre((piece.end - piece.begin) / piece.length * k / parts);
    for (const Index i : piece.active) largest[i] = std::max(largest[i], piece.y.col(i).dot(at));
  }
  return largest;
}

/// Of the piece and the one before.
double longest_of(const std::vector<EventPiece>& pieces, std::size_t k) {
  const auto length = [](const EventPiece& piece) { return piece.end - piece.begin; };
  return std::max(length(pieces[k]), k > 0 ? length(pieces[k - 1]) : 0);
}

double place_in(const EventPiece& p, double t) { return (std::clamp(t, p.begin, p.end) - p.begin) / p.length; }

}  // namespace

const EventPiece& LocatedSolution::piece(double t, bool left) const {
  const auto after = [left](double at, const EventPiece& p) { return left ? at <= p.begin : at < p.begin; };
  auto it = std::upper_bound(pieces.begin(), pieces.end(), t, after);
  if (it != pieces.begin()) --it;
  return *it;
}

Vector LocatedSolution::x(double t, bool left) const {
  const EventPiece& p = piece(t, left);
  return p.x.transpose() * legendre(place_in(p, t));
}

Vector LocatedSolution::y(double t, bool left) const {
  const EventPiece& p = piece(t, left);
  return p.y.transpose() * legendre(place_in(p, t));
}

Vector LocatedSolution::integral_of_y(double t, bool left) const {
  const EventPiece& p = piece(t, left);
  return p.integral + p.length * (p.y.transpose() * legendre_integrals(place_in(p, t)));
}

std::vector<ModeChange> mode_changes(const LocatedSolution& s) {
  std::vector<ModeChange> found;
  for (std::size_t p = 1; p < s.pieces.size(); ++p)
    for (std::size_t k = 0; k < s.pieces[p].modes.size(); ++k)
      if (const Index from = s.pieces[p - 1].modes[k], to = s.pieces[p].modes[k]; from != to)
        found.push_back({s.pieces[p].begin, Index(k), from, to});
  return found;
}

std::vector<Switch> switches_of(const LocatedSolution& s, double negligible) {
  const std::vector<EventPiece>& pieces = s.pieces;
  if (pieces.empty()) return {};
  const Index n = pieces.front().y.cols();
  RowMatrix largest(Index(pieces.size()), n);
  for (std::size_t k = 0; k < pieces.size(); ++k) largest.row(Index(k)) = largest_y(pieces[k]).transpose();
  const Vector zero = negligible * largest.colwise().maxCoeff().transpose();
  const double rounding = 4 * epsilon * pieces.back().end;
  const Vector start = s.y(0, false);
  std::vector<Switch> found;
  for (std::size_t k = 0; k < pieces.size(); ++k)
    for (Index i = 0; i < n; ++i) {
      const bool before = (k == 0 ? start[i] : largest(Index(k) - 1, i)) > zero[i], on = largest(Index(k), i) > zero[i];
      if (before == on) continue;
      const bool passed = pieces[k].passed || (k > 0 && pieces[k - 1].passed);
      found.push_back({pieces[k].begin, i, on, passed ? longest_of(pieces, k) : rounding});
    }
  return found;
}

}  // namespace bromwich
