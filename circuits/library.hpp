#pragma once

#include <string_view>

namespace bromwich::circuits {

/// Subcircuits that every netlist may call, below a title line; those of the netlist with the same name go before.
std::string_view library();

}  // namespace bromwich::circuits
