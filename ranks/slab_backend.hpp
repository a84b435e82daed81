#pragma once

#include "../core/seam/backend.hpp"
#include "../core/seam/communicator.hpp"
