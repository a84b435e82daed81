#pragma once
// What the part bromwich_hdf5.so offers (files/loaded_part.hpp): the functions on HDF5 files.

#include "files/checkpoint.hpp"
#include "files/stored_result.hpp"
#include "files/sweep_file.hpp"

namespace bromwich {

struct Hdf5Part {
  decltype(&create_hdf5) create;
  decltype(&continue_hdf5) continue_after;
  decltype(&create_vtkhdf) create_vtk;
  decltype(&continue_vtkhdf) continue_vtk;
  decltype(&create_sweep_hdf5) create_sweep;
  decltype(&read_sweep_hdf5) read_sweep;
  decltype(&read_hdf5) read;
  decltype(&write_checkpoint) write_point;
  decltype(&read_checkpoint) read_point;
};

}  // namespace bromwich
