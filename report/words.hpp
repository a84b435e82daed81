#pragma once
// What the summary of a solve (`bromwich solve --json`, schema "bromwich/1") says, in words.

#include <nlohmann/json.hpp>

#include <optional>
#include <string>
#include <vector>

namespace bromwich::report {

/// JSON whose keys keep their order.
using Json = nlohmann::ordered_json;

/// The value at a path of keys, such as "errors/tolerance"; empty if it is missing or null.
std::optional<double> number_at(const Json& summary, const std::string& path);
std::string text_at(const Json& summary, const std::string& path);             ///< "" if missing
std::vector<double> numbers_at(const Json& summary, const std::string& path);  ///< null becomes NaN; empty if missing

/// One or two sentences on how the solve has ended.
std::string status_sentence(const Json& summary);

struct Certificate {
  std::string name, value, meaning;
};
/// What was checked, with the number found and what it means. Only what the summary has.
std::vector<Certificate> certificates(const Json& summary);

}  // namespace bromwich::report
