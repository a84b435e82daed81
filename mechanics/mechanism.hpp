#pragma once

#include "core/scene/scene.hpp"

#include "bromwich/mechanics.hpp"
