#pragma once

#include "../core/result/options.hpp"
#include "../core/result/result.hpp"
#include "../core/scene/scene.hpp"
#include "../core/seam/backend.hpp"
#include "bromwich/batch.hpp"
