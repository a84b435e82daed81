#pragma once
// Changes of data, and weights of solutions, as derivatives accept them.

#include "../core/base/error.hpp"
#include "../core/base/text.hpp"
#include "../core/base/types.hpp"

namespace bromwich {

/// Throws Error where the table has another shape, or an entry that is not finite; an empty table is none.
inline void check_table(const char* name, const Eigen::Ref<const RowMatrix>& table, Index rows, Index columns) {
  if (table.size() == 0) return;
  if (table.rows() != rows || table.cols() != columns)
    throw Error(name, text("found %ld x %ld", long(table.rows()), long(table.cols())),
                text("give %ld x %ld", long(rows), long(columns)));
  if (!((0 * table).sum() == 0)) throw Error(name, "has an entry that is not finite", "give finite numbers");
}

/// x0 or b, whichever the scene does not have. Throws Error where it is given.
inline void check_no_b(const Vector& b) {
  if (b.size() > 0) throw Error("b", "is given to a scene with an initial value", "change x0");
}
inline void check_no_x0(const Vector& x0) {
  if (x0.size() > 0) throw Error("x0", "is given to a scene with a boundary condition", "change b");
}

/// Throws Error where no impacts are located.
inline void check_no_restitution(const Vector& restitution) {
  if (restitution.size() > 0)
    throw Error("restitution", "changes where impacts are not located", "take the derivative with located switches");
}

/// Throws Error where a member of a DataChange that all scenes have has another shape; f and g have `rows` rows.
template <class Change>
void check_data(const Change& c, Index rows, Index m, Index n) {
  check_table("x0", c.x0, m, 1);
  check_table("f", c.f, rows, m);
  check_table("g", c.g, rows, n);
  check_table("A", c.A, m, m);
  check_table("B", c.B, m, n);
  check_table("N", c.N, n, m);
  check_table("M", c.M, n, n);
  check_table("E", c.E, m, m);
}

}  // namespace bromwich
