#pragma once

#include "../scene/scene.hpp"
#include "result.hpp"
