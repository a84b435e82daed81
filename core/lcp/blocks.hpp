#pragma once
// Complementarity problems over a product of sets. With w = W z + q each block of rows has a law of its own:
//
//     orthant   0 <= z ⊥ w >= 0                                  (march/impact_problem.hpp)
//     cone      0 <= z_n ⊥ w_n >= 0,  |z_t| <= mu z_n,  z_t = -mu z_n w_t / |w_t| where w_t != 0
//     disc      w_n = 0, and the law of z_t and w_t as before: a normal force that is given
//
// The law of a block is F(z, w) = 0 with z - F the projection of z - rho w: onto [0, inf) for z_n, then onto the disc
// of radius mu times that for z_t (Alart & Curnier, Comput. Methods Appl. Mech. Engrg. 92, 1991). One block is solved
// exactly. Several are solved by Newton's method on F, which is semismooth, between sweeps of exact solves of each
// block in turn (nonsmooth Gauss-Seidel: Jourdan, Alart & Jean, ibid. 155, 1998).

#include "../base/types.hpp"

#include <memory>
#include <utility>
#include <vector>

namespace bromwich {

class Block {
 public:
  explicit Block(std::vector<Index> rows) : rows_(std::move(rows)) {}
  virtual ~Block() = default;

  const std::vector<Index>& rows() const { return rows_; }

  /// Units of z, and rho, each row of the block, from its own W.
  virtual void scale(const Matrix& W, Vector& unit, Vector& rho) const = 0;
  /// F(z, w), and matrices with dF = by_z dz + by_w dw where they are asked for.
  virtual Vector law(const Vector& z, const Vector& w, const Vector& rho, Matrix* by_z, Matrix* by_w) const = 0;
  /// The nearest z that the set has.
  virtual Vector project(Vector z) const = 0;
  /// z with F(z, W z + q) = 0. False: none is found.
  virtual bool solve(const Matrix& W, const Vector& q, Vector& z) const = 0;

 private:
  std::vector<Index> rows_;
};

/// Three rows, n and t.
class FrictionBlock final : public Block {
 public:
  FrictionBlock(Index first, double mu, bool given) : Block({first, first + 1, first + 2}), mu_(mu), given_(given) {}

  void scale(const Matrix& W, Vector& unit, Vector& rho) const override;
  Vector law(const Vector& z, const Vector& w, const Vector& rho, Matrix* by_z, Matrix* by_w) const override;
  Vector project(Vector z) const override;
  bool solve(const Matrix& W, const Vector& q, Vector& z) const override;

 private:
  double mu_;
  bool given_;
};

using Blocks = std::vector<std::unique_ptr<const Block>>;

struct BlockSolution {
  Vector z;
  double residual = 0;  ///< largest F over its unit, relative to the largest rho q
  bool solved = false;  ///< residual <= tolerance
  Index newton = 0, sweeps = 0;
};

/// The blocks have all rows. Precondition: W and q are finite.
BlockSolution solve_blocks(const Matrix& W, const Vector& q, const Blocks&, double tolerance, Index most_sweeps);

/// The residual of any z.
double residual_of_blocks(const Matrix& W, const Vector& q, const Blocks&, const Vector& z);

}  // namespace bromwich
