#include "files/loaded_part.hpp"
#include "files/stored_result.hpp"

namespace bromwich {

std::string part_abi() {
  std::string abi = std::string(BROMWICH_VERSION) + ", compiler " + __VERSION__;
  for (const std::size_t size : {sizeof(ResultColumns), sizeof(FileTarget), sizeof(StoredResult), sizeof(Vector)})
    abi += ", " + std::to_string(size);
  return abi;
}

}  // namespace bromwich
