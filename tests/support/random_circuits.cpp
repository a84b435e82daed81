// Random circuits, reduced by the sparse tableau: node potentials, voltages and currents of all elements are unknown,
// one elimination gives them as functions of the states, of y and of the sources.

#include "tests/support/engineering_scene.hpp"
#include "tests/support/random_draws.hpp"

#include <Eigen/Dense>

#include <cmath>
#include <numbers>
#include <numeric>
#include <optional>

namespace bromwich::oracle {
namespace {

enum class Kind { R, L, C, V, diode, gated };

struct Element {
  Kind kind;
  Index from, to;
  double value = 0;    ///< ohm, henry, farad; of diodes and switches the resistance when they conduct
  double off = 0;      ///< conductance beside a diode or switch
  double forward = 0;  ///< volt
  std::vector<std::pair<double, Index>> source = {};  ///< of V: factors of signals; of switches: its gate
  bool in_tree = false;  ///< an ideal diode or switch that alone joins two parts: its voltage is unknown
};

struct Circuit {
  Index nodes = 0;
  std::vector<Element> elements;
  std::vector<TimeSignal> signals;
  double highest_voltage = 0, highest_current = 0;  ///< bounds of blocking and of conducting switches
};

double digits(double value) {  // three of them, as on a part
  const double unit = std::pow(10, std::floor(std::log10(value)) - 2);
  return std::round(value / unit) * unit;
}

class Drawing {
 public:
  Drawing(Draw& d) : d_(d), f_(decades(1.7, 5)), Z_(decades(0.5, 3)), V_(decades(0.5, 2.6)) {}

  Circuit circuit() {
    c_ = {};
    c_.signals = {{}};
    c_.highest_voltage = 30 * V_, c_.highest_current = 100 * V_ / Z_;
    const Index diodes = d_.chance(0.7) ? d_.index(2, 5) : d_.index(6, 12);
    const Index gates = d_.chance(0.4) ? d_.index(1, 2) : 0;
    c_.nodes = d_.index(3, 4 + diodes / 2);
    off_ = d_.chance(0.5) ? 1 / digits(Z_ * decades(3, 6)) : 0;
    on_ = d_.chance(0.5) ? digits(Z_ * decades(-3, -1.5)) : 0;
    forward_ = d_.chance(0.5) ? 0.1 * double(d_.index(3, 8)) : 0;
    for (Index node = 1; node < c_.nodes; ++node) add(drawn(), node, d_.index(0, node - 1));
    for (Index k = 0; k < diodes; ++k) anywhere(Kind::diode);
    for (Index k = 0; k < gates; ++k) anywhere(Kind::gated);
    for (Index k = d_.index(1, 3); k > 0; --k) anywhere(Kind::R);
    for (Index k = d_.index(1, 3); k > 0; --k) anywhere(d_.chance(0.5) ? Kind::L : Kind::C);
    for (Index k = d_.index(1, 2); k > 0; --k) source();
    return c_;
  }
  double frequency() const { return f_; }
  double volts() const { return V_; }

 private:
  double decades(double a, double b) { return std::pow(10, d_.uniform(a, b)); }
  Kind drawn() {
    static constexpr Kind kinds[] = {Kind::R, Kind::R, Kind::L, Kind::C, Kind::C, Kind::diode};
    return kinds[d_.index(0, 5)];
  }
  void anywhere(Kind kind) {
    const Index a = d_.index(0, c_.nodes - 1), b = (a + d_.index(1, c_.nodes - 1)) % c_.nodes;
    add(kind, a, b);
  }
  void add(Kind kind, Index a, Index b) {
    const double w = 2 * std::numbers::pi * f_;
    Element e{kind, a, b};
    if (kind == Kind::R) e.value = digits(Z_ * (d_.chance(0.1) ? decades(-3.5, 3.5) : decades(-1.5, 1.5)));
    if (kind == Kind::L) e.value = digits(Z_ / w * (d_.chance(0.1) ? decades(-2.5, -1) : decades(-1, 1.5)));
    if (kind == Kind::C) e.value = digits(1 / (w * Z_) * (d_.chance(0.1) ? decades(-2.5, -1) : decades(-1, 1.5)));
    if (kind == Kind::diode) e.value = on_, e.off = off_, e.forward = V_ > 3 ? forward_ : 0;
    if (kind == Kind::gated) e.value = on_, e.off = off_, e.source = {{1, gate()}};
    c_.elements.push_back(e);
  }
  Index signal(const TimeSignal& s) {
    c_.signals.push_back(s);
    return Index(c_.signals.size()) - 1;
  }
  Index gate() {
    const double period = 1 / (f_ * (d_.chance(0.3) ? double(d_.index(2, 40)) : 1));
    return signal({TimeSignal::Kind::pulse, period * d_.uniform(0, 1), period, period * d_.uniform(0.15, 0.85)});
  }
  void source() {  // at a node of its own, behind a resistor
    const Index inner = c_.nodes++, a = d_.index(0, inner - 1), b = (a + d_.index(1, inner - 1)) % inner;
    Element e{Kind::V, inner, b};
    const double V = digits(V_ * d_.uniform(0.3, 1));
    const Index kind = d_.index(0, 4);
    if (kind < 3) e.source = {{V, signal({TimeSignal::Kind::sine, 2 * std::numbers::pi * f_, d_.uniform(0, 6), 0})}};
    if (kind == 3) e.source = {{2 * V, gate()}, {-V, 0}};
    if (kind == 4) e.source = {{V, 0}};
    c_.elements.push_back(e);
    c_.elements.push_back({Kind::R, inner, a, digits(Z_ * decades(-3, -0.5))});
  }

  Draw& d_;
  double f_, Z_, V_, off_ = 0, on_ = 0, forward_ = 0;
  Circuit c_;
};

/// Ideal diodes and switches that close no loop with what is before them take the form of the tree.
void choose_forms(Circuit& c) {
  std::vector<Index> part(std::size_t(c.nodes), 0);
  std::iota(part.begin(), part.end(), Index(0));
  const auto join = [&](const Element& e) {
    const Index a = part[std::size_t(e.from)], b = part[std::size_t(e.to)];
    for (Index& p : part)
      if (p == b) p = a;
    return a != b;
  };
  for (const Element& e : c.elements)
    if (e.kind == Kind::V || e.kind == Kind::C || e.kind == Kind::R || e.off > 0) join(e);
  for (Element& e : c.elements)
    if ((e.kind == Kind::diode || e.kind == Kind::gated) && e.off == 0) e.in_tree = join(e);
}

/// The equations of the tableau. Columns on the right: states, y, signals.
class Tableau {
 public:
  explicit Tableau(const Circuit& c) : c_(c), E_(Index(c.elements.size())), k_(Index(c.signals.size())) {
    for (const Element& e : c.elements) {
      m_ += e.kind == Kind::L || e.kind == Kind::C;
      n_ += e.kind == Kind::diode ? 1 : e.kind == Kind::gated ? 2 : 0;
    }
  }

  /// None if the tableau is singular (loops of capacitors, cuts of coils).
  std::optional<EngineeringScene> scene() {
    const Index size = c_.nodes - 1 + 2 * E_;
    left_ = Matrix::Zero(size, size), right_ = Matrix::Zero(size, m_ + n_ + k_);
    Index state = 0, y = m_;
    for (Index e = 0; e < E_; ++e) {
      connect(e);
      law(e, state, y);
    }
    Eigen::FullPivLU<Matrix> lu(left_);
    lu.setThreshold(1e-11);
    if (m_ == 0 || m_ > 10 || n_ > 14 || !lu.isInvertible()) return std::nullopt;
    solved_ = lu.solve(right_);
    return assemble();
  }

 private:
  Index v(Index e) const { return c_.nodes - 1 + e; }
  Index i(Index e) const { return c_.nodes - 1 + E_ + e; }

  void connect(Index e) {
    const Element& element = c_.elements[std::size_t(e)];
    left_(v(e), v(e)) = 1;
    for (const auto& [node, sign] : {std::pair(element.from, 1.0), std::pair(element.to, -1.0)}) {
      if (node == 0) continue;
      left_(node - 1, i(e)) += sign;
      left_(v(e), node - 1) -= sign;
    }
  }
  /// The law of an element in row i(e).
  void law(Index e, Index& state, Index& y) {
    const Element& x = c_.elements[std::size_t(e)];
    const auto row = [&](double of_v, double of_i) { left_(i(e), v(e)) = of_v, left_(i(e), i(e)) = of_i; };
    switch (x.kind) {
      case Kind::R:
        return row(1, -x.value);
      case Kind::L:
        row(0, 1), right_(i(e), state++) = 1;
        return;
      case Kind::C:
        row(1, 0), right_(i(e), state++) = 1;
        return;
      case Kind::V:
        row(1, 0);
        for (const auto& [factor, signal] : x.source) right_(i(e), m_ + n_ + signal) += factor;
        return;
      case Kind::diode:
        if (x.in_tree)
          row(1, -x.value), right_(i(e), y++) = -1, right_(i(e), m_ + n_) = x.forward;
        else
          row(-x.off, 1), right_(i(e), y++) = 1;
        return;
      case Kind::gated:
        if (x.in_tree)
          row(1, -x.value);
        else
          row(-x.off, 1);
        right_(i(e), y++) = 1, right_(i(e), y++) = -1;
        return;
    }
  }
  EngineeringScene assemble() const {
    EngineeringScene s;
    s.signals = c_.signals;
    Matrix rates(m_, right_.cols()), gaps = Matrix::Zero(n_, right_.cols());
    s.weight = Vector(m_);
    Index state = 0, w = 0;
    for (Index e = 0; e < E_; ++e) {
      const Element& x = c_.elements[std::size_t(e)];
      if (x.kind == Kind::L || x.kind == Kind::C) {
        rates.row(state) = solved_.row(x.kind == Kind::L ? v(e) : i(e)) / x.value;
        s.weight[state++] = std::sqrt(x.value);
      }
      if (x.kind == Kind::diode) {
        gaps.row(w) = (x.in_tree ? 1 : -1) * solved_.row(x.in_tree ? i(e) : v(e));
        if (!x.in_tree) gaps(w, m_ + w) += x.value, gaps(w, m_ + n_) += x.forward;
        ++w;
      }
      if (x.kind == Kind::gated) gate(x, e, w, gaps);
    }
    s.A = rates.leftCols(m_), s.B = rates.middleCols(m_, n_), s.F = rates.rightCols(k_);
    s.N = gaps.leftCols(m_), s.M = gaps.middleCols(m_, n_), s.G = gaps.rightCols(k_);
    for (Matrix* matrix : {&s.A, &s.B, &s.F, &s.N, &s.M, &s.G}) {  // rounding of what is zero
      const double least = 1e-14 * (matrix->size() > 0 ? matrix->cwiseAbs().maxCoeff() : 0);
      *matrix = matrix->unaryExpr([=](double value) { return std::abs(value) < least ? 0 : value; });
    }
    return s;
  }
  /// p and q of a switch: w = bound(t) -+ (v - R (p - q)), or bound(t) -+ i in the tree.
  void gate(const Element& x, Index e, Index& w, Matrix& gaps) const {
    const Index signal = m_ + n_ + x.source.front().second;
    for (const double sign : {-1.0, 1.0}) {
      Eigen::RowVectorXd seen = solved_.row(x.in_tree ? i(e) : v(e));
      const Index p = m_ + (sign < 0 ? w : w - 1);
      if (!x.in_tree) seen[p] -= x.value, seen[p + 1] += x.value;
      gaps.row(w) = sign * seen;
      gaps(w, m_ + n_) += x.in_tree ? 1e-9 * c_.highest_current : c_.highest_voltage;
      gaps(w, signal) += x.in_tree ? c_.highest_current : -c_.highest_voltage;
      ++w;
    }
  }

  const Circuit& c_;
  Index E_, k_, m_ = 0, n_ = 0;
  Matrix left_, right_, solved_;
};

}  // namespace

EngineeringScene random_circuit(std::uint32_t seed) {
  Draw draw(seed + 1000003);
  Drawing drawing(draw);
  while (true) {
    Circuit circuit = drawing.circuit();
    choose_forms(circuit);
    std::optional<EngineeringScene> made = Tableau(circuit).scene();
    if (!made) continue;
    made->name = "circuit-" + std::to_string(seed);
    made->period = 1 / drawing.frequency();
    made->T = made->period * (draw.chance(0.1) ? double(draw.index(20, 60)) : draw.uniform(2, 6));
    made->x0 = Vector::Zero(made->states());
    if (draw.chance(0.25))
      made->x0 = drawing.volts() * draw.vector(made->states()).cwiseQuotient(made->weight) * made->weight.minCoeff();
    return *made;
  }
}

}  // namespace bromwich::oracle
