#include "core/numerics/row_products.hpp"

#include "core/numerics/row_panel.hpp"

namespace bromwich {

RowMatrix row_products(const Eigen::Ref<const RowMatrix>& x, const SparseMatrix& A) {
  RowMatrix products(x.rows(), A.cols());
  RowPanel panel, product(A.cols());
  product.set_zero();
  each_panel(nullptr, x.rows(), x.cols(), [&] {
    return [&](Index first, Index count) {
      panel.load(x, first, count);
      panel.each_product(A, [&](Index j, const RowPanel::Column& column) { product.col(j) = column; });
      product.store(products, first, count);
    };
  });
  return products;
}

Vector row_forms(const Eigen::Ref<const RowMatrix>& x, const SparseMatrix& A) {
  Vector forms(x.rows());
  RowPanel panel;
  each_panel(nullptr, x.rows(), x.cols(), [&] {
    return [&](Index first, Index count) {
      panel.load(x, first, count);
      forms.segment(first, count) = panel.form(A, panel).head(count);
    };
  });
  return forms;
}

void add_row_products(const Vector& w, const Eigen::Ref<const RowMatrix>& x, const SparseMatrix& A,
                      Eigen::Ref<RowMatrix> to) {
  RowPanel panel, sum;
  each_panel(nullptr, x.rows(), x.cols(), [&] {
    return [&](Index first, Index count) {
      panel.load(x, first, count);
      sum.load(to, first, count);
      const RowPanel::Column factors = RowPanel::column(w, first, count);
      panel.each_product(A, [&](Index j, const RowPanel::Column& column) { sum.col(j) += factors * column; });
      sum.store(to, first, count);
    };
  });
}

}  // namespace bromwich
