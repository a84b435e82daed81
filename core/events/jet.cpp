#include "core/events/jet.hpp"

namespace bromwich {

Jet stacked(const Jet& a, const Jet& b) {
  const auto both = [](const Matrix& p, const Matrix& q) {
    Matrix all(p.rows() + q.rows(), p.cols());
    all << p, q;
    return all;
  };
  return of_blocks(both, a, b);
}

Jet rows_of(const Jet& c, const std::vector<Index>& rows) {
  return of_blocks([&rows](const Matrix& a) -> Matrix { return a(rows, Eigen::all); }, c);
}

Jet absolute(const Jet& c) {
  return of_blocks([](const Matrix& a) -> Matrix { return a.cwiseAbs(); }, c);
}

Jet operator+(const Jet& a, const Jet& b) {
  return of_blocks([](const Matrix& p, const Matrix& q) -> Matrix { return p + q; }, a, b);
}

Jet Jet::zero(Index rows, Index m, Index n) {
  const Matrix of_m = Matrix::Zero(rows, m), of_n = Matrix::Zero(rows, n);
  return {of_m, of_m, of_m, of_n, of_n, of_n};
}

Jet operator*(const Matrix& left, const Jet& c) {
  return {left * c.x, left * c.f, left * c.df, left * c.g, left * c.dg, left * c.ddg};
}

Vector evaluate(const Jet& c, const JetValues& u) {
  return c.x * u.x + c.f * u.f + c.df * u.df + c.g * u.g + c.dg * u.dg + c.ddg * u.ddg;
}

Vector terms(const Jet& c, const JetValues& u) {
  Vector sum = c.x.cwiseAbs() * u.x;
  sum.noalias() += c.f.cwiseAbs() * u.f;
  sum.noalias() += c.df.cwiseAbs() * u.df;
  sum.noalias() += c.g.cwiseAbs() * u.g;
  sum.noalias() += c.dg.cwiseAbs() * u.dg;
  sum.noalias() += c.ddg.cwiseAbs() * u.ddg;
  return sum;
}

}  // namespace bromwich
