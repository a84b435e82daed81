#pragma once
// Words in files and on command lines: conversion to numbers, and the nearest known name to a misspelt one.

#include "core/solve/solve.hpp"

#include <optional>
#include <string>
#include <string_view>
#include <vector>

namespace bromwich {

/// "a, b, c"
std::string join(const std::vector<std::string>& words);

/// The nearest candidate within a third of the name's length (at least 2 edits) of `name`, or nothing.
std::optional<std::string> nearest(const std::string& name, const std::vector<std::string>& candidates);

/// " (did you mean 'x'?)" or "", to be appended to the value found: a candidate that means the same ("gpu": 'cuda'), or
/// the nearest one.
std::string suggestion(const std::string& name, const std::vector<std::string>& candidates);

/// Replaces line breaks and runs of blanks by one blank and removes other characters that move the cursor.
std::string one_line(std::string_view text);

/// The whole word as a number; empty if it is not a number, is not finite or has trailing characters.
std::optional<double> parse_double(std::string_view word);
std::optional<long long> parse_integer(std::string_view word);

/// A whole number, also "1e6"; empty for others.
std::optional<long long> parse_count(std::string_view word);

/// The words of a list "0.1,0.25" at its commas.
std::vector<std::string> split_list(const std::string& list);

/// "all", "none" or a list "0,3,7" or "x0,v" of different components of the state, by number or by name.
struct StateChoice {
  StateSelection selection = StateSelection::none;
  std::vector<Index> components;
};
/// Throws Error(argument, ...) for anything else.
StateChoice parse_state_choice(const std::string& argument, const std::string& word, const Scene& scene);

}  // namespace bromwich
