#pragma once
// What the expressions of a file mean, and values that were made from them: for the next scene of the file a value is
// made again only where something that it used has another meaning.

#include "catalogue/catalogue.hpp"
#include "files/shorthand.hpp"

#include <memory>
#include <string>
#include <unordered_map>
#include <utility>
#include <variant>
#include <vector>

namespace bromwich {

/// What names of a file stand for.
struct Meanings {
  ParameterValues parameters;
  Definitions definitions;  ///< spelled out

  bool has(const std::string& name) const { return parameters.contains(name) || definitions.contains(name); }
};

class KeptValues {
 public:
  /// `now`: the meanings of the scene that is being read. It lives as long as these values.
  explicit KeptValues(const Meanings& now) : now_(now) {}
  KeptValues(const KeptValues&) = delete;
  KeptValues& operator=(const KeptValues&) = delete;

  /// Every value that is being made depends on the meaning of this name, and of the names in it. Precondition:
  /// now.has(name).
  void use(const std::string& name);

  /// make(), or what it has returned before under this key with the same `given` and the same meanings of all names
  /// that it used. `make` has no other inputs. The value stays until the next call with this key.
  template <class Make>
  const auto& get(const std::string& key, const std::vector<double>& given, const Make& make) {
    using Value = std::decay_t<decltype(make())>;
    Entry& entry = entries_[key];
    if (!entry.value || entry.given != given || !still_true(entry.used)) {
      const Making making(*this);
      auto value = std::make_shared<const Value>(make());
      entry = {given, used_in_last(), std::move(value)};
    }
    for (const auto& [name, meaning] : entry.used) note(name, meaning);
    return *static_cast<const Value*>(entry.value.get());
  }

 private:
  using Meaning = std::variant<double, std::string>;
  using Used = std::vector<std::pair<std::string, Meaning>>;
  struct Entry {
    std::vector<double> given;
    Used used;
    std::shared_ptr<const void> value;
  };
  /// While a value is made, names that are used belong to it.
  struct Making {
    explicit Making(KeptValues& all) : all_(all) { all_.open_.emplace_back(); }
    ~Making() { all_.open_.pop_back(); }
    Making(const Making&) = delete;
    Making& operator=(const Making&) = delete;
    KeptValues& all_;
  };

  bool still_true(const Used&) const;
  void note(const std::string& name, const Meaning&);
  Used used_in_last() const { return open_.back(); }

  const Meanings& now_;
  std::unordered_map<std::string, Entry> entries_;
  std::vector<Used> open_;  ///< of the values that are being made, the outer ones first
};

}  // namespace bromwich
