#pragma once
// The scenes of a [sweep], read by several threads.

#include "app/scene_choice.hpp"
#include "core/base/threads.hpp"
#include "files/sweep.hpp"

#include <functional>
#include <memory>
#include <mutex>
#include <string>
#include <vector>

namespace bromwich::app {

/// Consecutive scenes of a sweep.
struct ReadScenes {
  std::vector<Scene> scenes;        ///< those without an error, in order
  std::vector<Index> places;        ///< of each scene of the sweep in `scenes`, or -1
  std::vector<std::string> errors;  ///< of each scene; empty where there is none
  bool same_sources = false;        ///< as in Batch
};

class SweepScenes {
 public:
  /// The parameters of `settings` have the same values in all scenes.
  SweepScenes(std::string name, ParameterValues settings, Sweep);
  ~SweepScenes();

  const Sweep& sweep() const { return sweep_; }
  /// The first scene that can be read. Throws the Error of the last one if none can.
  SceneChoice first();
  /// Each thread reads ranges of scenes with a reader of its own. Dynamics that no parameter changes are those of the
  /// first scene, whichever thread has read them. Scenes are left out once `stopped` returns true.
  ReadScenes read(Index first, Index count, const HostThreads&, const std::function<bool()>& stopped);

 private:
  struct Reader;
  std::unique_ptr<Reader> take();
  void give(std::unique_ptr<Reader>);
  SceneChoice choice(Reader&, Index scene) const;
  void start_block(Reader&, Index model) const;

  std::string name_;
  ParameterValues settings_;
  Sweep sweep_;
  std::mutex mutex_;
  std::vector<std::unique_ptr<Reader>> idle_;
};

}  // namespace bromwich::app
