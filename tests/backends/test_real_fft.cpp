// Contract of the transforms of cpu/real_fft.hpp against sums in long double. Two programs have this file: one with the
// library that BROMWICH_TRANSFORM names, one with the other.

#include "cpu/cpu_backend.hpp"
#include "cpu/real_fft.hpp"
#include "tests/support/reference.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cctype>
#include <cmath>
#include <complex>
#include <cstdlib>
#include <string>
#include <vector>

namespace bromwich {
namespace {

using cpu::RealFft;
using cpu::SineFft;
using reference::Random;

/// One, small, powers, a prime below and above the lengths at which libraries change their algorithm, 2^a 3^b 5^c.
const std::vector<Index> lengths{1, 2, 3, 4, 5, 7, 8, 16, 17, 60, 97, 128, 243, 1021, 1024, 1080};

constexpr long double exact_pi = 3.141592653589793238462643383279502884L;

/// exp(2 pi i a / N) for a = 0..N-1.
std::vector<std::complex<long double>> roots(Index N) {
  std::vector<std::complex<long double>> all;
  for (Index a = 0; a < N; ++a) {
    const long double angle = 2 * exact_pi * (long double)a / (long double)N;
    all.emplace_back(std::cos(angle), std::sin(angle));
  }
  return all;
}

/// A sum of N values below 1 by a tree of depth log2 N, each level with a few roundings of values below N: relative to
/// the 2-norm sqrt(N) of random values the error is below 8 eps (1 + log2 N) sqrt(N). Bluestein's form of primes takes
/// three such transforms of up to four times the length.
double tolerance(Index N) { return 24 * epsilon * (3 + std::log2(double(N))) * std::sqrt(4.0 * double(N)); }

std::vector<std::complex<long double>> spectrum_of(const Vector& x) {
  const Index N = x.size();
  const auto root = roots(N);
  std::vector<std::complex<long double>> X;
  for (Index k = 0; k <= N / 2; ++k) {
    std::complex<long double> sum = 0;
    for (Index j = 0; j < N; ++j) sum += std::conj(root[std::size_t(j * k % N)]) * (long double)x[j];
    X.push_back(sum);
  }
  return X;
}

double distance(const ComplexVector& found, const std::vector<std::complex<long double>>& exact) {
  long double largest = 0;
  for (std::size_t k = 0; k < exact.size(); ++k)
    largest = std::max(largest, std::abs(std::complex<long double>(found[Index(k)]) - exact[k]));
  return double(largest);
}

TEST(RealFft, ForwardIsTheSum) {
  for (const Index N : lengths) {
    const RealFft fft(N);
    ASSERT_EQ(fft.length(), N);
    ASSERT_EQ(fft.frequencies(), N / 2 + 1);
    const Vector x = Random(std::uint32_t(N)).vector(N);
    const Vector given = x;
    ComplexVector X(fft.frequencies());
    fft.forward(x.data(), X.data());
    EXPECT_LE(distance(X, spectrum_of(x)), tolerance(N)) << N;
    EXPECT_EQ(x, given) << "the input is not touched: " << N;
    EXPECT_EQ(X[0].imag(), 0) << N;
    EXPECT_TRUE(N % 2 == 1 || X[N / 2].imag() == 0) << N;

    ComplexVector aligned(fft.frequencies());
    RealFft::forward_of_aligned(N).forward(x.data(), aligned.data());
    EXPECT_LE((aligned - X).cwiseAbs().maxCoeff(), 2 * tolerance(N)) << N;
  }
}

TEST(RealFft, BackwardIsTheSum) {
  for (const Index N : lengths) {
    const RealFft fft(N);
    const Vector x = Random(std::uint32_t(N) + 1).vector(N);
    const auto exact = spectrum_of(x);
    ComplexVector X(fft.frequencies());
    for (Index k = 0; k < X.size(); ++k)
      X[k] = Complex(double(exact[std::size_t(k)].real()), double(exact[std::size_t(k)].imag()));
    Vector back(N);
    fft.backward(X.data(), back.data());
    // N times the values; the spectrum was rounded once.
    EXPECT_LE((back - double(N) * x).cwiseAbs().maxCoeff(), std::sqrt(double(N)) * tolerance(N)) << N;
  }
}

TEST(RealFft, CopiesAndUnalignedBuffers) {
  const Index N = 60;
  const RealFft first(N), second = first;
  const Vector x = Random(7).vector(N + 1);
  ComplexVector a(N / 2 + 1), b(N / 2 + 2);
  first.forward(x.data() + 1, a.data());
  second.forward(x.data() + 1, b.data() + 1);
  EXPECT_EQ(a, b.tail(N / 2 + 1));
}

TEST(SineFft, IsTheSum) {
  for (const Index n : lengths) {
    const SineFft sine(n), copy = sine;
    const Vector x = Random(std::uint32_t(n) + 2).vector(n);
    const Vector given = x;
    Vector out(n);
    copy.apply(x.data(), out.data());
    EXPECT_EQ(x, given) << "the input is not touched: " << n;
    const auto root = roots(2 * (n + 1));
    for (Index k = 0; k < n; ++k) {
      long double sum = 0;
      for (Index j = 0; j < n; ++j)
        sum += 2 * root[std::size_t((j + 1) * (k + 1) % (2 * (n + 1)))].imag() * (long double)x[j];
      EXPECT_NEAR(out[k], double(sum), tolerance(2 * (n + 1))) << n << ' ' << k;
    }
  }
}

TEST(Transform, IsThatOfTheProgram) {
  const char* expected = std::getenv("BROMWICH_TRANSFORM_LIBRARY");  // set for the second program
  if (!expected) GTEST_SKIP() << "this is the program of the build, with " << cpu::transform_library();
  std::string found = cpu::transform_library();
  std::transform(found.begin(), found.end(), found.begin(), [](unsigned char c) { return char(std::tolower(c)); });
  EXPECT_EQ(found, expected);
  EXPECT_NE(make_cpu_backend(1)->device().detail.find(cpu::transform_library()), std::string::npos);
}

}  // namespace
}  // namespace bromwich
