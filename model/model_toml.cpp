#include <charconv>
#include <string>

#include "base/toml_reader.hpp"
#include "model/catalogue.hpp"
#include "model/composed.hpp"
#include "model/length_scale.hpp"

namespace isorig::model {
namespace {

constexpr std::string_view kFormat = "isorig-model/1";

std::string number(double value) {
  char text[32];
  const auto end = std::to_chars(text, text + sizeof text, value).ptr;
  std::string out(text, end);
  // TOML tells integers from floats; ours are floats.
  if (out.find_first_of(".einf") == std::string::npos) out += ".0";
  return out;
}

/// A basic string of TOML.
std::string toml_string(std::string_view text) {
  std::string out = "\"";
  for (const char c : text) {
    if (c == '"' || c == '\\') {
      (out += '\\') += c;
    } else if (const auto code = static_cast<unsigned char>(c); code < 0x20 || code == 0x7f) {
      constexpr std::string_view kDigits = "0123456789ABCDEF";
      ((out += "\\u00") += kDigits[code >> 4U]) += kDigits[code & 0xFU];
    } else {
      out += c;
    }
  }
  return out += '"';
}

std::string known_names(std::span<const Physics* const> list) {
  std::string names;
  for (const Physics* physics : list) names += (names.empty() ? "" : ", ") + std::string(physics->name);
  return names;
}

void read_part(const base::TomlTable& table, ModelSpec& spec) {
  const std::string name = table.string("physics");
  const Physics* physics = find_physics(name);
  if (physics == nullptr) {
    table.error("physics", "unknown physics \"" + name + "\"; elements: " + known_names(elements()) +
                               "; effects: " + known_names(effects()));
    table.ignore_rest();
    return;
  }
  const std::string law_name = table.string_or("law", physics->laws.front().name);
  const Law* known = find_law(*physics, law_name);
  if (known == nullptr) {
    std::string names;
    for (const Law& each : physics->laws) names += (names.empty() ? "" : ", ") + std::string(each.name);
    table.error("law", name + " has no law \"" + law_name + "\"; it has: " + names);
    table.ignore_rest();
    return;
  }
  const Law* law = &law_at(*known, spec.length_scale);
  Part part = make_part(*physics, *law);
  for (std::size_t i = 0; i < law->parameters.size(); ++i) {
    const Parameter& parameter = law->parameters[i];
    part.parameters[i] = table.number_or(parameter.name, part.parameters[i], {parameter.lower, parameter.upper});
  }
  for (std::size_t i = 0; i < law->coefficients.size(); ++i) {
    const Coefficient& coefficient = law->coefficients[i];
    base::Range range;
    if (coefficient.sign == Sign::kNonNegative) range.min = 0.0;
    if (coefficient.sign == Sign::kNonPositive) range.max = 0.0;
    const double start = coefficient.sign == Sign::kNonNegative ? 1.0 : 0.0;
    part.coefficients[i] = table.number_or(coefficient.name, start, range);
  }
  part.fixed = table.boolean_or("fixed", false);
  if (law->make_table) {
    part.table.first = table.number("table_first");
    part.table.step = table.number("table_step", base::kPositive);
    part.table.values = table.numbers("table_values");
    if (part.table.values.empty()) table.error("table_values", "table_values needs at least one value");
  }
  spec.parts.push_back(std::move(part));
}

/// [seen]; its [[seen.nominal]] are parts.
Seen read_seen(const base::TomlTable& table, double length_scale) {
  Seen seen;
  const auto pair = [&](const char* key, double& low, double& high) {
    const std::vector<double> values = table.numbers(key);
    if (values.size() != 2 || values[0] > values[1]) {
      table.error(key, std::string(key) + " is the lowest and the highest value, in this order");
      return;
    }
    low = values[0];
    high = values[1];
  };
  pair("position_mm", seen.lowest_mm, seen.highest_mm);
  pair("pressure_psi", seen.lowest_psi, seen.highest_psi);
  seen.fastest_mm_s = table.number("rate_mm_s", base::kNonNegative);
  seen.travel_mm = table.number("travel_mm", base::kNonNegative);
  seen.duration_s = table.number("duration_s", base::kNonNegative);
  if (table.has("recordings")) seen.recordings = table.numbers("recordings");
  seen.zero_elsewhere_N = table.number_or("zero_elsewhere_N", 0.0);
  seen.error_N = table.number("error_N", base::kNonNegative);
  seen.share = table.number_or("share", 1.0, {1e-6, 1.0});
  seen.covariance = table.numbers("covariance");
  ModelSpec nominal;
  nominal.length_scale = length_scale;
  for (const base::TomlTable& part : table.tables("nominal")) read_part(part, nominal);
  if (nominal.coefficient_count() > 32) table.error("nominal", "more than 32 coefficients");
  seen.nominal = std::move(nominal.parts);
  if (seen.nominal.empty()) table.error("nominal", "[seen] needs at least one [[seen.nominal]]");
  return seen;
}

ModelSpec read_document(const base::TomlDocument& document) {
  const base::TomlTable root = document.root();
  ModelSpec spec;
  if (const std::string format = root.string("format"); format != kFormat && root.has("format"))
    root.error("format", "format is \"" + format + "\", this program reads \"" + std::string(kFormat) + "\"");
  spec.name = root.string_or("name", "");
  spec.length_scale = root.number_or("length_scale", 1.0, {1e-6, 1e6});
  if (root.has("pressure_from_psi")) spec.pressure_from_psi = root.number("pressure_from_psi", {-14.7, 1e4});
  const auto parts = root.tables("part");
  if (parts.empty()) root.error("part", "a model needs at least one [[part]]");
  for (const base::TomlTable& part : parts) read_part(part, spec);
  if (spec.coefficient_count() > 32) root.error("part", "more than 32 coefficients");
  if (root.has("seen")) spec.seen = read_seen(root.table("seen"), spec.length_scale);
  document.finish();
  return spec;
}

std::string numbers_text(std::span<const double> values) {
  std::string out = "[";
  for (std::size_t i = 0; i < values.size(); ++i)
    out += (i == 0 ? "" : i % 8 == 0 ? ",\n  " : ", ") + number(values[i]);
  return out + "]";
}

std::string parts_text(std::span<const Part> parts, std::string_view key) {
  std::string out;
  for (const Part& part : parts) {
    out += "\n[[" + std::string(key) + "]]  # " + std::string(side_of(part.physics->stage));
    out += "\nphysics = " + toml_string(part.physics->name) + "\nlaw = " + toml_string(part.law->name);
    out += "  # " + std::string(part.law->formula) + "\n";
    for (std::size_t i = 0; i < part.parameters.size(); ++i)
      out += std::string(part.law->parameters[i].name) + " = " + number(part.parameters[i]) + "\n";
    for (std::size_t i = 0; i < part.coefficients.size(); ++i)
      out += std::string(part.law->coefficients[i].name) + " = " + number(part.coefficients[i]) + "\n";
    if (part.fixed) out += "fixed = true\n";
    if (part.law->make_table) {
      out += "table_first = " + number(part.table.first) + "\ntable_step = " + number(part.table.step) +
             "\ntable_values = " + numbers_text(part.table.values) + "\n";
    }
  }
  return out;
}

std::string seen_text(const Seen& seen) {
  const double position_mm[] = {seen.lowest_mm, seen.highest_mm}, pressure_psi[] = {seen.lowest_psi, seen.highest_psi};
  return "\n[seen]  # what the model was fitted to; beyond it predictions fade to the nominal model\nposition_mm = " +
         numbers_text(position_mm) + "\nrate_mm_s = " + number(seen.fastest_mm_s) +
         "\ntravel_mm = " + number(seen.travel_mm) + "\npressure_psi = " + numbers_text(pressure_psi) +
         "\nduration_s = " + number(seen.duration_s) +
         (seen.recordings.empty() ? "" : "\nrecordings = " + numbers_text(seen.recordings)) +
         (seen.zero_elsewhere_N == 0.0 ? "" : "\nzero_elsewhere_N = " + number(seen.zero_elsewhere_N)) +
         "\nerror_N = " + number(seen.error_N) + "  # rms of a reading that was left out of the fit\n" +
         (seen.share < 1.0 ? "share = " + number(seen.share) + "  # predicted of what is beyond the nominal model\n"
                           : "") +
         "covariance = " + numbers_text(seen.covariance) + "\n" + parts_text(seen.nominal, "seen.nominal");
}

}  // namespace

ModelSpec read_model(const std::filesystem::path& file) {
  ModelSpec spec = read_document(base::TomlDocument::parse_file(file));
  if (spec.name.empty()) spec.name = file.stem().string();
  return spec;
}

ModelSpec parse_model(std::string_view text, std::string name) {
  return read_document(base::TomlDocument::parse_text(text, std::move(name)));
}

std::string model_text(const ModelSpec& spec, std::string_view comment) {
  std::string out;
  while (!comment.empty()) {
    const std::size_t end = comment.find('\n');
    out += "# " + std::string(comment.substr(0, end)) + "\n";
    comment = end == std::string_view::npos ? std::string_view{} : comment.substr(end + 1);
  }
  out += "format = " + toml_string(kFormat) + "\nname = " + toml_string(spec.name) + "\n";
  if (spec.length_scale != 1.0)
    out += "length_scale = " + number(spec.length_scale) + "  # of the ranges that lengths may have\n";
  if (spec.pressure_from_psi && spec.reads_pressure())
    out += "pressure_from_psi = " + number(*spec.pressure_from_psi) + "  # what its parts count the pressure from\n";
  out += parts_text(spec.parts, "part");
  if (spec.seen) out += seen_text(*spec.seen);
  return out;
}

}  // namespace isorig::model
