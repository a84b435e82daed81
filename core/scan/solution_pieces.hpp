#pragma once
// The affine pieces of the solutions of one kind of step (core/host/affine_pieces.hpp), found one by one: at a given q,
// the problem is solved, and the piece is that of its active set S.
//
// W_SS regular: (y_S, w_I) is the principal transform of W on S. Singular, of a monotone problem whose solution of
// least norm is wanted: with E = {i : w_i = 0}, which contains S, y_S = -W_ES^+ q_E, and the equations of E that do not
// determine y_S have to hold beside.
//
// Equations hold up to the rounding that the states have gathered on the way. So do values that the scene keeps at
// zero: where a q lies beside its piece by no more than that, the piece is given again for such rounding.

#include "../lcp/active_set.hpp"
#include "../seam/chunk_march.hpp"

#include <optional>
#include <vector>

namespace bromwich {

/// A step whose matrices are known, before it is scaled: Y in SOL(W, q), q = see s + ...
struct PieceProblem {
  Matrix W;  ///< of the unknowns first .. first + W.rows() - 1; the others are zero
  LcpClass lcp_class = LcpClass::unknown;
  Index first = 0;
};

class SolutionPieces {
 public:
  /// The step gets the scaling of the problem: rows of see, q and of_q, columns of drive and shown, and `unit`.
  SolutionPieces(PieceProblem, ChunkStep&);

  /// The piece of q, in scaled units. Empty: there is no solution, or the piece is known.
  std::optional<ChunkPiece> at(const Vector& q);
  /// The last q had no piece because its problem has no solution, or lies beside a known piece by more than rounding.
  bool failed() const { return failed_; }
  /// From now on known pieces are those of earlier marches, which a q beside them contradicts.
  void settle() { settled_ = known_.size(); }

 private:
  struct Sets {
    unsigned active, equal;
    bool gathered;  ///< for gathered rounding
    bool operator==(const Sets&) const = default;
  };
  ChunkPiece regular_piece(const std::vector<Index>& S, const Matrix& inverse) const;
  ChunkPiece singular_piece(const std::vector<Index>& S, const std::vector<Index>& E) const;
  void differentiate(ChunkPiece&) const;

  PieceProblem problem_;
  const ChunkStep& step_;
  Equilibration scale_;
  Matrix scaled_;
  ActiveSetLcp lcp_;
  std::vector<Sets> known_;
  std::size_t settled_ = 0;
  bool failed_ = false;
};

}  // namespace bromwich
