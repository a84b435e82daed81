// Reads a scene file through the installed package and solves it. Exit code 0 if y is right.

#include <bromwich/bromwich.hpp>
#include <bromwich/cpu/cpu_backend.hpp>
#include <bromwich/files/scene_file.hpp>

#include <cstdio>

int main() {
  if (!bromwich::scene_files_available()) return 0;
  // y = max(0, -x) with x' = -1, x(0) = 1/2.
  const bromwich::SceneFile file = bromwich::parse_scene(
      "[parameters]\nrate = -1\n[dynamics]\nA = \"zero(1)\"\nB = [[0]]\nf = [\"rate\"]\nx0 = [0.5]\n"
      "[complementarity]\nN = [[1]]\nM = [[1]]\n[time]\nT = 1\nsteps = 10\n",
      "own.toml");
  const auto backend = bromwich::make_cpu_backend(1);
  const bromwich::Result result = bromwich::solve(file.scene, *backend);
  double error = 0;
  for (bromwich::Index j = 0; j < result.y.rows(); ++j)
    error = std::max(error, std::abs(result.y(j, 0) - std::max(0.0, result.t[j] - 0.5)));
  std::printf("%s, error %g\n", bromwich::to_string(result.status), error);
  try {
    bromwich::parse_scene("[time]\nT = \"a\"\n", "bad.toml");
  } catch (const bromwich::Error& refused) {
    std::printf("%s\n", refused.argument().c_str());
    return result.status == bromwich::Status::solved && error < 1e-13 && refused.argument().starts_with("bad.toml:")
               ? 0
               : 1;
  }
  return 1;
}
