#pragma once

#include "solve.hpp"
