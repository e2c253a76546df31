#include "proof/sealed.hpp"

#include <openssl/evp.h>

#include <array>
#include <fstream>
#include <stdexcept>

#include "base/text_file.hpp"

namespace isorig::proof {

std::string sha256(std::string_view bytes) {
  std::array<unsigned char, EVP_MAX_MD_SIZE> digest{};
  unsigned int length = 0;
  if (EVP_Digest(bytes.data(), bytes.size(), digest.data(), &length, EVP_sha256(), nullptr) != 1)
    throw std::runtime_error("SHA-256 is not available");
  constexpr std::string_view kDigits = "0123456789abcdef";
  std::string text;
  for (unsigned int i = 0; i < length; ++i) {
    text += kDigits[digest[i] >> 4];
    text += kDigits[digest[i] & 15];
  }
  return text;
}

void write_text(const std::filesystem::path& file, std::string_view text) {
  if (file.has_parent_path()) std::filesystem::create_directories(file.parent_path());
  std::ofstream stream(file, std::ios::binary | std::ios::trunc);
  stream << text;
  stream.flush();
  if (!stream) throw std::runtime_error(file.string() + ": cannot be written");
}

void seal(const std::filesystem::path& labels, const std::filesystem::path& hash_file, std::string_view text) {
  write_text(labels, text);
  write_text(hash_file, sha256(text) + "  " + labels.filename().string() + "\n");
}

std::string published_hash(const std::filesystem::path& hash_file) {
  const std::string line = base::read_text_file(hash_file);
  constexpr std::size_t kHexDigits = 64;
  if (line.size() < kHexDigits || line.find_first_not_of("0123456789abcdef") < kHexDigits)
    throw std::runtime_error(hash_file.string() + ": no SHA-256");
  return line.substr(0, kHexDigits);
}

std::string unseal(const std::filesystem::path& labels, const std::filesystem::path& hash_file) {
  std::string text = base::read_text_file(labels);
  const std::string published = published_hash(hash_file);
  if (const std::string now = sha256(text); now != published)
    throw std::runtime_error(labels.string() + " was changed after it was sealed: SHA-256 " + now + ", published " +
                             published);
  return text;
}

}  // namespace isorig::proof
