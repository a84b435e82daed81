#pragma once
// Products of the derivatives of steps, with the active sets of the steps held.
//
// A step x -> x+ with the active set S has the derivative P_S. Sets last for many steps, so that a run of r of them is
// one power: P_S^r by repeated squaring, whose squares are kept.

#include "../base/types.hpp"

#include <cstdint>
#include <map>
#include <vector>

namespace bromwich {

/// A set in 64-bit words, behind what else tells apart the maps of steps.
using SetKey = std::vector<std::uint64_t>;

/// Appends {i : y_i > 0}.
void append_positive(const Vector& y, SetKey&);
/// `hash` continued by `words`.
std::uint64_t hash_of(std::uint64_t hash, const SetKey& words);

/// Z with y = Z q on the active set of y: Z_SS = -W_SS^{-1}, zero elsewhere. Where W_SS is singular, of least norm.
Matrix held_solution(const Matrix& W, const Vector& y);

/// A square matrix with its powers.
class Powers {
 public:
  explicit Powers(Matrix P) : squares_{std::move(P)} {}
  const Matrix& first() const { return squares_.front(); }
  /// D <- P^r D.
  void apply(Index r, Matrix& D);

 private:
  std::vector<Matrix> squares_;  ///< P^(2^k)
};

/// The product of the derivatives of steps, the last one leftmost.
class HeldProduct {
 public:
  /// Begins with the identity, m x m.
  void begin(Index m);
  /// One more step, whose derivative is that of `key`: make() where it is not known yet.
  template <class Make>
  void step(const SetKey& key, const Make& make) {
    if (run_ == 0 || key != key_) {
      end_run();
      if (known_.size() >= most_known_) known_.clear();
      power_ = &known_.try_emplace(key, Powers(Matrix())).first->second;
      if (power_->first().size() == 0) *power_ = Powers(make());
      key_ = key;
    }
    ++run_;
  }
  /// The product so far.
  const Matrix& product() {
    end_run();
    return D_;
  }
  /// A hash of the keys of all steps.
  std::uint64_t sets() {
    end_run();
    return hash_;
  }

 private:
  void end_run();

  static constexpr std::size_t most_known_ = 4096;
  std::map<SetKey, Powers> known_;
  Powers* power_ = nullptr;  ///< of the run
  SetKey key_;
  Index run_ = 0;
  Matrix D_;
  std::uint64_t hash_ = 0;
};

}  // namespace bromwich
