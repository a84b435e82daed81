#include "app/sweep_scenes.hpp"

#include "app/text.hpp"
#include "core/base/error.hpp"

#include <algorithm>
#include <optional>
#include <utility>

namespace bromwich::app {

/// The model is the first scene of a block: by its dynamics and sources a reader recognises those of the others.
struct SweepScenes::Reader {
  SceneSource source;
  Index model = -1;  ///< its number in the sweep
  Dynamics dynamics = {};
  Index sources = 0;
};

SweepScenes::SweepScenes(std::string name, ParameterValues settings, Sweep sweep)
    : name_(std::move(name)), settings_(std::move(settings)), sweep_(std::move(sweep)) {}
SweepScenes::~SweepScenes() = default;

std::unique_ptr<SweepScenes::Reader> SweepScenes::take() {
  {
    const std::lock_guard lock(mutex_);
    if (!idle_.empty()) {
      std::unique_ptr<Reader> reader = std::move(idle_.back());
      idle_.pop_back();
      return reader;
    }
  }
  return std::unique_ptr<Reader>(new Reader{SceneSource(name_)});
}

void SweepScenes::give(std::unique_ptr<Reader> reader) {
  const std::lock_guard lock(mutex_);
  idle_.push_back(std::move(reader));
}

SceneChoice SweepScenes::choice(Reader& reader, Index scene) const {
  ParameterValues settings = settings_;
  for (const auto& [name, value] : sweep_.settings(scene)) settings[name] = value;
  return reader.source.with(settings);
}

SceneChoice SweepScenes::first() {
  std::unique_ptr<Reader> reader = take();
  for (Index k = 0;; ++k) try {
      SceneChoice read = choice(*reader, k);
      give(std::move(reader));
      return read;
    } catch (const Error&) {
      if (k + 1 >= sweep_.scenes()) throw;
    }
}

void SweepScenes::start_block(Reader& reader, Index model) const {
  if (reader.model == model) return;
  reader.dynamics = choice(reader, model).scene.dynamics;
  reader.sources = reader.source.sources();
  reader.model = model;
}

ReadScenes SweepScenes::read(Index first, Index count, const HostThreads& threads,
                             const std::function<bool()>& stopped) {
  constexpr Index fewest = 64;  // of a range: as many cost more than a file that is parsed again
  std::vector<std::optional<Scene>> read(static_cast<std::size_t>(count));
  std::vector<char> same(std::size_t(count), 0);
  ReadScenes result;
  result.errors.resize(std::size_t(count));
  const auto read_one = [&](Reader& reader, Index i) {
    try {
      if (stopped()) throw Error("scene", "was not read", "stopped on request");
      read[std::size_t(i)] = choice(reader, first + i).scene;
    } catch (const Error& error) {
      result.errors[std::size_t(i)] = one_line(error.what());
    }
    return read[std::size_t(i)].has_value();
  };

  Index model = 0;
  std::unique_ptr<Reader> reader = take();
  while (model < count && !read_one(*reader, model)) ++model;
  give(std::move(reader));
  if (model < count) same[std::size_t(model)] = 1;

  const Index others = std::max<Index>(count - model - 1, 0),
              length = std::max(fewest, others / (4 * threads.threads()));
  share(threads, others, length, [&](Index begin, Index end) {
    std::unique_ptr<Reader> own = take();
    start_block(*own, first + model);
    for (Index i = model + 1 + begin; i < model + 1 + end; ++i) {
      if (!read_one(*own, i)) continue;
      Scene& scene = *read[std::size_t(i)];
      if (&*scene.dynamics == &*own->dynamics) scene.dynamics = read[std::size_t(model)]->dynamics;
      same[std::size_t(i)] = own->source.sources() == own->sources;
    }
    give(std::move(own));
  });

  result.same_sources = true;
  for (std::size_t i = 0; i < read.size(); ++i) {
    result.places.push_back(read[i] ? Index(result.scenes.size()) : -1);
    if (!read[i]) continue;
    result.same_sources = result.same_sources && same[i];
    result.scenes.push_back(std::move(*read[i]));
  }
  return result;
}

}  // namespace bromwich::app
