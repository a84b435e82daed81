#pragma once
// The columns of an output file.

#include "core/result/result.hpp"
#include "core/scene/scene.hpp"

#include <string>
#include <vector>

namespace bromwich::app {

enum class ColumnKind : char { y, w, trace, x, mode, contact };

struct Column {
  ColumnKind kind = ColumnKind::y;
  Index component = 0;
  std::string name;  ///< y0, w0, trace0, x0, or that of the scene
};

/// Of --columns: y, w, trace (N x), x (all states), mode (of all memories), contact (all names in `contacts`) or single
/// columns by name, "y,w0,v". Throws Error for other words.
std::vector<Column> parse_columns(const std::string& words, const Scene& scene,
                                  const std::vector<std::string>& contacts = {});

/// Without --columns: all y, the recorded states, the modes of memories, and contacts.
std::vector<Column> default_columns(const Scene& scene, const std::vector<Index>& states,
                                    const std::vector<std::string>& contacts = {});

/// The components of the state among the columns, each once, increasing.
std::vector<Index> states_of(const std::vector<Column>& columns);
/// Whether numbers of contacts are among them, which need all states.
bool has_contacts(const std::vector<Column>& columns);
/// Whether N x is needed.
bool need_trace(const std::vector<Column>& columns);

}  // namespace bromwich::app
