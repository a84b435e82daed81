#pragma once
// How two files of `bromwich_frozen` differ, case by case.

#include <nlohmann/json.hpp>

#include <string>

namespace bromwich::frozen {

/// Largest difference of the rows that both have, each component relative to its largest value in `a`; infinite where
/// one has a value and the other has none, or the numbers of components differ.
double difference(const nlohmann::json& a, const nlohmann::json& b);

/// Prints every changed status, notice and value, and a table of counts. True if statuses and values are the same:
/// values up to `rounding`.
bool compare(const nlohmann::json& a, const nlohmann::json& b, double rounding);

}  // namespace bromwich::frozen
