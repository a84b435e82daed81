#pragma once

#include "../core/scene/scene.hpp"
#include "bromwich/catalogue.hpp"
