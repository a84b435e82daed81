#pragma once

#include "../result/options.hpp"
#include "../result/result.hpp"
#include "../scene/scene.hpp"
#include "../seam/backend.hpp"
#include "bromwich/solver.hpp"
