#pragma once

#include "../core/result/result.hpp"
#include "../core/seam/backend.hpp"
#include "bromwich/nonlinear.hpp"
#include "nonlinear_scene.hpp"
