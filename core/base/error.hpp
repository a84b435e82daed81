#pragma once

#include "bromwich/error.hpp"
