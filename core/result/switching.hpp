#pragma once

#include "result.hpp"
