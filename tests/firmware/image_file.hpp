#pragma once
// What is in the built images, read from the files that are flashed: Intel HEX for the bytes, ELF for the
// symbols.
#include <elf.h>
#include <gtest/gtest.h>

#include <cstdint>
#include <cstring>
#include <fstream>
#include <iterator>
#include <map>
#include <string>
#include <vector>

namespace isorig::firmware {

using Memory = std::map<std::uint32_t, std::uint8_t>;

inline std::uint32_t word_at(const Memory& memory, std::uint32_t address) {
  std::uint32_t word = 0;
  for (std::uint32_t i = 0; i < 4; ++i) word |= std::uint32_t{memory.at(address + i)} << (8 * i);
  return word;
}

/// Throws for a bad checksum or an unknown record.
inline Memory read_hex(const std::string& path) {
  std::ifstream file(path);
  Memory memory;
  std::uint32_t base = 0;
  bool has_ended = false;
  for (std::string line; std::getline(file, line);) {
    if (line.ends_with('\r')) line.pop_back();
    if (has_ended || line.size() < 11 || line[0] != ':') throw std::runtime_error("not a record: " + line);
    std::vector<std::uint8_t> bytes;
    for (std::size_t i = 1; i + 1 < line.size(); i += 2) {
      bytes.push_back(static_cast<std::uint8_t>(std::stoul(line.substr(i, 2), nullptr, 16)));
    }
    std::uint8_t sum = 0;
    for (const std::uint8_t byte : bytes) sum = static_cast<std::uint8_t>(sum + byte);
    if (sum != 0 || bytes.size() != bytes[0] + 5U) throw std::runtime_error("bad checksum: " + line);
    const std::uint32_t address = base + (std::uint32_t{bytes[1]} << 8 | bytes[2]);
    switch (bytes[3]) {
      case 0:
        for (std::uint32_t i = 0; i < bytes[0]; ++i) memory[address + i] = bytes[4 + i];
        break;
      case 1:
        has_ended = true;
        break;
      case 2:
        base = (std::uint32_t{bytes[4]} << 8 | bytes[5]) << 4;
        break;
      case 3:
      case 5:
        break;  // where to start: the vector table says so
      case 4:
        base = (std::uint32_t{bytes[4]} << 8 | bytes[5]) << 16;
        break;
      default:
        throw std::runtime_error("unknown record: " + line);
    }
  }
  if (!has_ended) throw std::runtime_error(path + ": no end record");
  return memory;
}

class ElfImage {
 public:
  struct Symbol {
    std::uint32_t value = 0;
    std::uint32_t size = 0;
  };
  struct Segment {
    std::uint32_t load_address = 0, address = 0, file_size = 0, size = 0;
  };

  explicit ElfImage(const std::string& path) {
    std::ifstream file(path, std::ios::binary);
    bytes_.assign(std::istreambuf_iterator<char>(file), {});
    header = get<Elf32_Ehdr>(0);
    for (unsigned i = 0; i < header.e_phnum; ++i) {
      const auto segment = get<Elf32_Phdr>(header.e_phoff + i * header.e_phentsize);
      if (segment.p_type == PT_LOAD) {
        segments.push_back({segment.p_paddr, segment.p_vaddr, segment.p_filesz, segment.p_memsz});
      }
    }
    for (unsigned i = 0; i < header.e_shnum; ++i) {
      const auto section = get<Elf32_Shdr>(header.e_shoff + i * header.e_shentsize);
      if (section.sh_type != SHT_SYMTAB) continue;
      const auto names = get<Elf32_Shdr>(header.e_shoff + section.sh_link * header.e_shentsize);
      for (std::size_t at = 0; at < section.sh_size; at += sizeof(Elf32_Sym)) {
        const auto symbol = get<Elf32_Sym>(section.sh_offset + at);
        symbols[bytes_.data() + names.sh_offset + symbol.st_name] = {symbol.st_value, symbol.st_size};
      }
    }
  }

  Elf32_Ehdr header{};
  std::vector<Segment> segments;
  std::map<std::string, Symbol> symbols;

 private:
  template <class T>
  [[nodiscard]] T get(std::size_t offset) const {
    T value{};
    if (offset + sizeof value > bytes_.size()) throw std::runtime_error("a truncated ELF file");
    std::memcpy(&value, bytes_.data() + offset, sizeof value);
    return value;
  }
  std::string bytes_;
};

}  // namespace isorig::firmware
