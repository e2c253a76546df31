#include "tree.hpp"

namespace isorig::test {

std::string source_path(std::string_view below) {
  return std::string(ISORIG_SOURCE_DIR).append(below);
}

std::string program_path(std::string_view below) {
  return std::string(ISORIG_BIN_DIR).append(below);
}

}  // namespace isorig::test
