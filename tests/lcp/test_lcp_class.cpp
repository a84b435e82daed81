// Classes of matrices, their tests, and the bounds that depend on them.

#include "core/lcp/lcp_class.hpp"
#include "core/lcp/lipschitz.hpp"
#include "tests/support/lcp_oracle.hpp"
#include "tests/support/oracle.hpp"
#include "tests/support/reference.hpp"

#include <gtest/gtest.h>
#include <Eigen/Dense>

#include <algorithm>
#include <array>

namespace bromwich {
namespace {

using reference::cycling;
using reference::fold;
using reference::Random;
using reference::tridiagonal;

const Matrix relays{{0, 0, 1, 0}, {0, 0, 0, 1}, {-1, 0, 0, 0}, {0, -1, 0, 0}};

TEST(LcpClass, SignsOfZ) {
  EXPECT_TRUE(is_Z(fold));
  EXPECT_FALSE(is_Z(cycling));
  EXPECT_TRUE(is_Z(tridiagonal(5, -1, -3, 0)));
  EXPECT_FALSE(is_Z(tridiagonal(5, -1, 4, 0.1)));
  EXPECT_TRUE(is_Z(tridiagonal(1, 7, -1, 7))) << "the two outer entries are not used";
  EXPECT_TRUE(is_Z(Matrix(0, 0)));
}

TEST(LcpClass, SufficientConditionsForP) {
  EXPECT_TRUE(is_surely_P(tridiagonal(8, -1, 4, -1)));
  EXPECT_TRUE(is_surely_P(tridiagonal(8, -1, 2, -1))) << "H+, though only weakly dominant";
  EXPECT_TRUE(is_surely_P(Matrix{{1, 100}, {-100, 1}})) << "positive definite symmetric part";
  EXPECT_TRUE(is_surely_P(Matrix{{1, 9}, {0.01, 10}})) << "dominant by columns";
  EXPECT_FALSE(is_surely_P(Matrix{{1, 1}, {1, 1}})) << "singular";
  EXPECT_FALSE(is_surely_P(Matrix{{-1}}));
  EXPECT_FALSE(is_surely_P(cycling));
  // What is accepted is P.
  Random random(1);
  int accepted = 0;
  for (int i = 0; i < 2000; ++i) {
    const Index n = 1 + i % 4;
    const Matrix M = random.matrix(n, n) + Matrix(random.uniform(0, 2) * Matrix::Identity(n, n));
    if (!is_surely_P(M)) continue;
    ++accepted;
    EXPECT_GT(oracle::smallest_principal_minor(M), 0) << M;
  }
  EXPECT_GT(accepted, 200);
}

TEST(LcpClass, ExactTestForP) {
  EXPECT_TRUE(is_P_exact(cycling));
  EXPECT_FALSE(is_P_exact(fold));
  EXPECT_FALSE(is_P_exact(Matrix{{0, 1}, {-1, 0}}));
  EXPECT_TRUE(is_P_exact(Matrix::Identity(16, 16)));
  Random random(2);
  int yes = 0;
  for (int i = 0; i < 1000; ++i) {
    const Index n = 1 + i % 5;
    const Matrix M = random.matrix(n, n) + Matrix(0.7 * Matrix::Identity(n, n));
    EXPECT_EQ(is_P_exact(M), oracle::smallest_principal_minor(M) > 0) << M;
    yes += is_P_exact(M);
  }
  EXPECT_GT(yes, 100);
  EXPECT_LT(yes, 900);
}

TEST(LcpClass, Classification) {
  EXPECT_EQ(classify(cycling), LcpClass::P);
  EXPECT_EQ(classify(fold), LcpClass::Z);
  EXPECT_EQ(classify(tridiagonal(39, -1, 4, -1)), LcpClass::P);
  EXPECT_EQ(classify(Matrix{{-1, 1}, {1, -1}}), LcpClass::unknown);
  EXPECT_EQ(classify(tridiagonal(39, -1, 2, -1)), LcpClass::P);
  EXPECT_EQ(classify(Matrix{{1, -2}, {-0.5, 1}}), LcpClass::Z) << "singular, and not PSD";
  EXPECT_EQ(classify(Matrix{{0, -1}, {-1, 1}}), LcpClass::unknown) << "Z with a zero on the diagonal: the user says so";
  for (const Matrix& both : {Matrix{{0, 0}, {0, 0}}, Matrix{{1, -1}, {-1, 1}}}) {
    EXPECT_EQ(classify(both), LcpClass::PSD);
    EXPECT_EQ(selection_class(both, LcpClass::automatic), LcpClass::Z) << "the least element has the least norm";
  }
  EXPECT_STREQ(to_string(LcpClass::P), "P");
  EXPECT_STREQ(to_string(LcpClass::Z), "Z");
}

/// D with entries 10^-6 ... 10^6.
Vector wild(Random& random, Index n) {
  return Vector::NullaryExpr(n, [&random] { return std::pow(10.0, random.uniform(-6, 6)); });
}

Tridiagonal random_tridiagonal(Random& random, Index n, double diagonal) {
  Tridiagonal t{random.vector(n), random.vector(n).array() + diagonal, random.vector(n)};
  t.lower[0] = t.upper[n - 1] = std::numeric_limits<double>::quiet_NaN();  // not used
  return t;
}

TEST(LcpClass, PositiveSemidefinite) {
  EXPECT_TRUE(is_PSD(relays)) << "skew";
  EXPECT_TRUE(is_PSD(Matrix(1e3 * Matrix::Ones(2, 2))));
  EXPECT_TRUE(is_PSD(Matrix(Matrix::Zero(3, 3))));
  EXPECT_TRUE(is_PSD(Tridiagonal{Vector::Ones(5), Vector::Zero(5), -Vector::Ones(5)})) << "skew";
  EXPECT_TRUE(is_PSD(tridiagonal(9, 1, 2, 1)));
  EXPECT_FALSE(is_PSD(tridiagonal(9, 1, 1.9, 1))) << "1.9 - 2 cos(pi/10) < 0";
  EXPECT_FALSE(is_PSD(fold));
  EXPECT_FALSE(is_PSD(Matrix{{1e6, 0}, {0, -1e-20}})) << "small is not zero";
  EXPECT_FALSE(is_PSD(Matrix{{1, 0}, {1e-9, 0}})) << "zero on the diagonal, not skew";
  EXPECT_EQ(classify(Matrix{{1e3, 1e3}, {1e3, 1e3}}), LcpClass::PSD);
  Random random(11);
  for (int i = 0; i < 2000; ++i) {
    const Index n = 2 + i % 7, rank = 1 + i % (n - 1);
    const Vector d = wild(random, n);
    const Matrix L = d.asDiagonal() * random.matrix(n, rank), K = d.asDiagonal() * random.matrix(n, n) * d.asDiagonal();
    const Matrix M = L * L.transpose() + (i % 3) * (K - K.transpose());
    EXPECT_TRUE(is_PSD(M)) << M;
    if (i % 3 == 0) {
      EXPECT_NE(classify(M), LcpClass::P) << "singular\n" << M;
    }
    // One eigenvalue of the scaled symmetric part moved to -1e-9: far above its rounding, n eps.
    const Matrix B = random.matrix(n, n - 1);
    const Eigen::SelfAdjointEigenSolver<Matrix> eigen(Matrix(B * B.transpose()));
    Vector values = eigen.eigenvalues();
    values[0] = -1e-9;
    const Matrix S = eigen.eigenvectors() * values.asDiagonal() * eigen.eigenvectors().transpose();
    EXPECT_FALSE(is_PSD(Matrix(d.asDiagonal() * S * d.asDiagonal()))) << S;
  }
}

TEST(LcpClass, ComparisonMatrices) {
  EXPECT_TRUE(is_H_plus(Matrix{{1, 3}, {-0.3, 1}}));
  EXPECT_FALSE(is_H_plus(Matrix{{1, 3}, {-0.4, 1}}));
  EXPECT_FALSE(is_H_plus(Matrix{{1, 1}, {1, 1}})) << "<M> is singular";
  EXPECT_FALSE(is_H_plus(Matrix{{-1, 0}, {0, 1}})) << "negative diagonal";
  EXPECT_TRUE(is_H_plus(tridiagonal(2000, -1, 2, 1)));
  EXPECT_FALSE(is_H_plus(tridiagonal(2000, -1, 1.99, 1)));
  Random random(12);
  int accepted = 0;
  for (int i = 0; i < 2000; ++i) {
    const Index n = 1 + i % 6;
    const Tridiagonal t = random_tridiagonal(random, n, 1.5);
    const Matrix T = to_dense(LcpMatrix(t));
    EXPECT_EQ(is_H_plus(t), is_H_plus(T));
    EXPECT_EQ(is_PSD(t), is_PSD(T));
    EXPECT_EQ(is_surely_P(t), is_surely_P(T));
    const Matrix M = random.matrix(n, n) + Matrix(1.5 * Matrix::Identity(n, n));
    const Matrix other = wild(random, n).asDiagonal() * M * wild(random, n).asDiagonal();
    EXPECT_EQ(is_H_plus(other), is_H_plus(M)) << "any scaling of rows and columns";
    EXPECT_EQ(is_P_exact(other), is_P_exact(M));
    if (!is_H_plus(M)) continue;
    ++accepted;
    EXPECT_TRUE(is_P_exact(M)) << M;
    // <M>^{-1} bounds the inverse of every M_SS; both are known to 1e-9 (condition up to 1e4).
    const Matrix bound = *inverse_comparison(M);
    for (unsigned set = 1; set < 1u << n; ++set) {
      std::vector<Index> S;
      for (Index k = 0; k < n; ++k)
        if (set >> k & 1u) S.push_back(k);
      const Matrix inverse = Eigen::FullPivLU<Matrix>(M(S, S)).inverse();
      EXPECT_TRUE((inverse.cwiseAbs().array() <= bound(S, S).array() * (1 + 1e-9)).all()) << M;
    }
  }
  EXPECT_GT(accepted, 300);
  EXPECT_FALSE(inverse_comparison(cycling));
  // Both forms of one matrix. ||<M>^{-1}|| <= 1: rounding of n operations.
  const Tridiagonal t = tridiagonal(50, -1, 3, 1);
  EXPECT_LE((*inverse_comparison(t) - *inverse_comparison(to_dense(LcpMatrix(t)))).cwiseAbs().maxCoeff(), 50 * epsilon);
}

TEST(LcpClass, LipschitzConstant) {
  Random random(13);
  for (int i = 0; i < 300; ++i) {
    const Index n = 1 + i % 8;
    const Matrix M = random.dominant(n);
    const double exact = oracle::lipschitz(M);
    EXPECT_NEAR(solution_lipschitz(M), exact, 1e-10 * exact);
    EXPECT_NEAR(solution_lipschitz(Matrix(1e-20 * M)), 1e20 * exact, 1e10 * exact);
  }
  EXPECT_EQ(solution_lipschitz(Matrix(Matrix::Ones(2, 2))), INFINITY);
  EXPECT_EQ(solution_lipschitz(relays), INFINITY);
  EXPECT_NEAR(solution_lipschitz(Matrix{{1e-20, 0}, {0, 1}}), 1e20, 1e6) << "small is not singular";
  // Above n = 12: by <M>^{-1}, by the smallest eigenvalue, or unknown.
  EXPECT_NEAR(solution_lipschitz(tridiagonal(20, -1, 4, -1)), 0.5, 1e-5);
  Matrix K = random.matrix(16, 16);
  EXPECT_NEAR(solution_lipschitz(Matrix(Matrix::Identity(16, 16) + 10 * (K - K.transpose()))), 4, 1e-10);
  EXPECT_EQ(solution_lipschitz(Matrix(K - K.transpose())), INFINITY);
  EXPECT_EQ(solution_lipschitz(Tridiagonal{Vector::Ones(20), Vector::Zero(20), -Vector::Ones(20)}), INFINITY);
  // An upper bound of the constant, compared with principal submatrices that can be enumerated.
  const Matrix M = random.dominant(14);
  for (Index k = 0; k < 7; ++k)
    EXPECT_GE(solution_lipschitz(M) * (1 + 1e-12), oracle::lipschitz(M.block(k, k, 8, 8))) << k;
}

TEST(LcpClass, NamesThatAUserMayState) {
  EXPECT_EQ(lcp_class_names(), (std::vector<std::string>{"auto", "P", "Z", "PSD"}));
  for (const std::string& name : lcp_class_names()) EXPECT_EQ(to_string(*lcp_class_named(name)), name);
  for (const char* name : {"unknown", "p", "", "P "}) EXPECT_FALSE(lcp_class_named(name)) << name;
}

// All isolated solutions of LCP(q, M), by trying every active set.
std::vector<Vector> all_solutions(const Matrix& M, const Vector& q) {
  std::vector<Vector> found;
  for (unsigned set = 0; set < 1u << q.size(); ++set) {
    std::vector<Index> S;
    for (Index i = 0; i < q.size(); ++i)
      if (set >> i & 1u) S.push_back(i);
    Vector y = Vector::Zero(q.size());
    if (!S.empty()) {
      const Eigen::FullPivLU<Matrix> lu(M(S, S));
      if (!lu.isInvertible()) continue;
      y(S) = lu.solve(Vector(-q(S)));
    }
    // Entries of size 1 with few digits: a solution has no entry between rounding and 1e-9.
    if (y.minCoeff() > -1e-9 && (M * y + q).minCoeff() > -1e-9) found.push_back(y);
  }
  return found;
}

// What the table says of a class holds for random members, which `classify` finds.
TEST(LcpClass, Promises) {
  Random random(6);
  std::array<int, lcp_class_table.size()> members{}, several{};
  for (int instance = 0; instance < 3000; ++instance) {
    const Index n = 1 + instance % 4;
    Matrix M = random.matrix(n, n);
    if (instance % 3 == 1) M = Matrix(-M.cwiseAbs()) + Matrix((2 * M.diagonal().cwiseAbs()).asDiagonal());
    const oracle::Monotone monotone = oracle::random_monotone(random, n, instance / 3 % 4);
    Vector q = random.vector(n);
    if (instance % 3 == 2) M = monotone.M, q = monotone.q;
    const LcpClass c = classify(M);
    ++members[std::size_t(c)];
    const std::vector<Vector> y = all_solutions(M, q);
    EXPECT_FALSE(has_one_solution(c) && y.empty()) << M;
    for (const Vector& other : y) {
      const double distance = (other - y.front()).cwiseAbs().maxCoeff();
      several[std::size_t(c)] += distance > 1e-6;
      EXPECT_FALSE(has_one_solution(c) && distance > 1e-6) << M;
      const Vector middle = 0.5 * (other + y.front());
      EXPECT_FALSE(has_convex_solutions(c) && middle.cwiseMin(M * middle + q).cwiseAbs().maxCoeff() > 1e-6) << M;
    }
    const bool has_least = std::any_of(y.begin(), y.end(), [&](const Vector& least) {
      return std::all_of(y.begin(), y.end(), [&](const Vector& o) { return (o - least).minCoeff() > -1e-6; });
    });
    EXPECT_FALSE(selects_least(c) && !y.empty() && !has_least) << M;
    if (!traits(c).in_schur_complement || n == 1 || !(M(0, 0) > 1e-3)) continue;
    const Matrix left = M.bottomRightCorner(n - 1, n - 1) - M.col(0).tail(n - 1) * M.row(0).tail(n - 1) / M(0, 0);
    const LcpClass of_left = classify(left);
    EXPECT_TRUE(of_left == c || (has_convex_solutions(c) && has_one_solution(of_left))) << M;
  }
  for (const LcpClass c : {LcpClass::P, LcpClass::Z, LcpClass::PSD, LcpClass::unknown})
    EXPECT_GT(members[std::size_t(c)], 100) << to_string(c);
  EXPECT_GT(several[std::size_t(LcpClass::Z)], 20);
  EXPECT_GT(several[std::size_t(LcpClass::PSD)], 20);
}

TEST(LcpClass, HowItIsKnown) {
  const auto told = [](const LcpMatrix& M) { return describe_class(M, classify(M)); };
  EXPECT_EQ(told(Matrix{{2, 1}, {-1, 2}}), "P (strictly diagonally dominant)");
  EXPECT_EQ(told(tridiagonal(20, -1, 2, -1)), "P (H+)");
  EXPECT_EQ(told(Matrix{{1, 100}, {-100, 1}}), "P (positive definite)");
  EXPECT_EQ(told(cycling), "P (all principal minors)");
  EXPECT_EQ(told(fold), "Z");
  EXPECT_EQ(told(relays), "PSD");
  EXPECT_EQ(told(Matrix{{-1}}), "unknown");
  Matrix large = Matrix::Identity(18, 18);
  large.topLeftCorner(3, 3) = cycling;
  EXPECT_EQ(describe_class(large, LcpClass::P), "P (as stated)");
}

TEST(LcpClass, Contradictions) {
  const auto says = [](const LcpMatrix& M, LcpClass c) { return contradiction(M, c).value_or("nothing"); };
  EXPECT_EQ(says(Matrix{{1, 0}, {2.5, 1}}, LcpClass::Z), "M has a positive entry off its diagonal, M(1,0) = 2.5");
  EXPECT_EQ(says(tridiagonal(3, -1, 1, 4), LcpClass::Z), "M has a positive entry off its diagonal, M(0,1) = 4");
  EXPECT_EQ(says(fold, LcpClass::Z), "nothing");
  EXPECT_EQ(says(fold, LcpClass::PSD), "the symmetric part of M has a negative eigenvalue");
  EXPECT_EQ(says(relays, LcpClass::PSD), "nothing");
  EXPECT_EQ(says(relays, LcpClass::P), "M has the diagonal entry M(0,0) = 0, not positive");
  EXPECT_EQ(says(fold, LcpClass::P), "the principal minor of M with rows 0, 1 is not positive");
  EXPECT_EQ(says(Matrix{{2, 0, 0}, {0, 1, 1}, {0, 1, 1}}, LcpClass::P),
            "the principal minor of M with rows 1, 2 is not positive");
  EXPECT_EQ(says(cycling, LcpClass::P), "nothing");
  EXPECT_EQ(says(fold, LcpClass::unknown), "nothing");
  EXPECT_EQ(says(fold, LcpClass::automatic), "nothing");
  Matrix large = Matrix::Identity(18, 18);
  large.topLeftCorner(2, 2) = fold;
  EXPECT_EQ(says(large, LcpClass::P), "nothing") << "too many minors: the residual tells";
}

}  // namespace
}  // namespace bromwich
