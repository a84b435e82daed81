#pragma once

#include "../result/inner_options.hpp"
#include "../result/result.hpp"
#include "../scene/scene.hpp"
#include "../seam/backend.hpp"

namespace bromwich {

/// Method galerkin on given steps, judged by the certificate where that takes the scene, else beside method march.
Result by_galerkin(const Scene&, Backend&, const InnerOptions&);

}  // namespace bromwich
