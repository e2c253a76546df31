#include "base/text_file.hpp"

#include <system_error>

namespace isorig::base {

std::string why_not_a_file(const std::filesystem::path& path) {
  using std::filesystem::file_type;
  std::error_code ignored;
  const char* kind = nullptr;
  switch (std::filesystem::status(path, ignored).type()) {
    case file_type::fifo:
      kind = "a pipe";
      break;
    case file_type::socket:
      kind = "a socket";
      break;
    case file_type::character:
    case file_type::block:
      kind = "a device";
      break;
    default:
      return {};
  }
  return std::string("is ") + kind + " and no file; save its content to a file and name that";
}

}  // namespace isorig::base
