#pragma once

#include "scene.hpp"
