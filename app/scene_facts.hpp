#pragma once
// What is known of a scene before it is solved, in words.

#include "core/scene/scene.hpp"

#include <string>

namespace bromwich::app {

/// The class of M and how it is known: "P (H+)", "PSD", ...; of its Schur complement where free rows can be eliminated.
std::string matrix_class(const Scene&);

/// "real, moduli 0.04 to 12.8" and the like; "not computed" for dense scenes of more than 400 states.
std::string spectrum_text(const Scene&);

}  // namespace bromwich::app
