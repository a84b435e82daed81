#pragma once

#include "../numerics/face_basis.hpp"
#include "bromwich/dynamics.hpp"
