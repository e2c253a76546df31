#pragma once
#include <filesystem>
#include <fstream>
#include <stdexcept>
#include <string>
#include <vector>

namespace isorig::test {

/// A chip of the kernel's gpio-sim with named lines, plugged in as long as this lives: /dev/gpiochipN behind a real
/// driver. Needs configfs and root, as the virtual bench has them.
class GpioSim {
 public:
  GpioSim(std::string name, std::string label, const std::vector<std::string>& lines)
      : directory_("/sys/kernel/config/gpio-sim/" + name) {
    namespace fs = std::filesystem;
    fs::create_directory(directory_);
    fs::create_directory(directory_ / "bank0");
    write(directory_ / "bank0/label", label);
    write(directory_ / "bank0/num_lines", std::to_string(lines.size()));
    for (std::size_t i = 0; i < lines.size(); ++i) {
      const auto line = directory_ / "bank0" / ("line" + std::to_string(i));
      fs::create_directory(line);
      write(line / "name", lines[i]);
      line_names_.push_back(lines[i]);
    }
    write(directory_ / "live", "1");
    chip_ = read(directory_ / "bank0/chip_name");
    device_ = fs::path("/sys/devices/platform") / read(directory_ / "dev_name") / chip_;
  }
  ~GpioSim() {
    std::error_code ignored;
    if (is_live_) write(directory_ / "live", "0");
    for (std::size_t i = 0; i < line_names_.size(); ++i) {
      std::filesystem::remove(directory_ / "bank0" / ("line" + std::to_string(i)), ignored);
    }
    std::filesystem::remove(directory_ / "bank0", ignored);
    std::filesystem::remove(directory_, ignored);
  }
  GpioSim(const GpioSim&) = delete;
  GpioSim& operator=(const GpioSim&) = delete;

  /// What an outside circuit does to an input. The kernel makes an edge of a change.
  void drive(std::size_t line, bool high) { write(of(line) / "pull", high ? "pull-up" : "pull-down"); }
  /// What stands on the line, whoever drives it.
  [[nodiscard]] bool value(std::size_t line) const { return read(of(line) / "value") == "1"; }
  /// Out of the socket, requests and all.
  void unplug() {
    write(directory_ / "live", "0");
    is_live_ = false;
  }
  [[nodiscard]] const std::string& chip() const { return chip_; }
  /// The kernel's files of a line: `pull` drives it, `value` shows it.
  [[nodiscard]] std::string file(std::size_t line, const std::string& name) const { return of(line) / name; }

 private:
  [[nodiscard]] std::filesystem::path of(std::size_t line) const {
    return device_ / ("sim_gpio" + std::to_string(line));
  }
  static void write(const std::filesystem::path& file, const std::string& text) {
    std::ofstream out(file);
    out << text << std::flush;
    if (!out) throw std::runtime_error("cannot write " + text + " to " + file.string());
  }
  static std::string read(const std::filesystem::path& file) {
    std::ifstream in(file);
    std::string text;
    if (!std::getline(in, text)) throw std::runtime_error("cannot read " + file.string());
    return text;
  }

  std::filesystem::path directory_, device_;
  std::string chip_;
  std::vector<std::string> line_names_;
  bool is_live_ = true;
};

}  // namespace isorig::test
