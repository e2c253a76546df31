#include "messages/foreign/mapping.hpp"

#include "base/number_text.hpp"
#include "base/toml_reader.hpp"

namespace isorig::foreign {
namespace {

constexpr std::string_view kFormat = "isorig-mapping/1";
constexpr base::Range kLength{0.0, 1e4, true};

/// A basic string of TOML 1.0: a quoted cell of a header may hold tabs and line ends, and is found again by its name.
std::string toml_string(std::string_view text) {
  std::string out = "\"";
  for (const char c : text) {
    constexpr std::string_view kDigits = "0123456789abcdef";
    const auto code = static_cast<unsigned char>(c);
    if (code < 0x20 || code == 0x7F) {
      ((out += "\\u00") += kDigits[code >> 4U]) += kDigits[code & 0xFU];
      continue;
    }
    if (c == '"' || c == '\\') out += '\\';
    out += c;
  }
  return out + '"';
}

/// TOML tells integers from floats.
std::string toml_number(double value) {
  const std::string text = base::exact_number_text(value);
  return text.find_first_of(".en") == std::string::npos ? text + ".0" : text;
}

std::string delimiter_text(char delimiter) {
  return delimiter == '\t' ? "tab" : delimiter == ' ' ? "blank" : std::string(1, delimiter);
}

}  // namespace

Mapping read_mapping(const std::filesystem::path& file) {
  const auto document = base::TomlDocument::parse_file(file);
  const auto root = document.root();
  Mapping mapping;
  static_cast<void>(root.choice("format", {kFormat}));
  if (root.has("delimiter")) {
    const auto text = root.choice("delimiter", {";", ",", "tab", "blank"});
    mapping.dialect.delimiter = text == "tab" ? '\t' : text == "blank" ? ' ' : text.empty() ? ',' : text[0];
  }
  if (root.has("decimal")) {
    const auto text = root.choice("decimal", {".", ","});
    mapping.dialect.decimal = text.empty() ? '.' : text[0];
  }
  if (root.has("output")) mapping.output = output_of(root.choice("output", {"force", "position", "pressure"}));
  if (const auto columns = root.table_if("column")) {
    for (const Field field : kFields)
      if (columns->has(name_of(field))) mapping.column[field] = columns->string(name_of(field));
  }
  if (const auto units = root.table_if("unit")) {
    for (const auto& key : units->keys()) {
      mapping.unit[key] = units->string(key);
      if (!find_unit(mapping.unit[key]))
        units->error(key, "unknown unit \"" + mapping.unit[key] + "\"; for a time: " + units_of(Field::kTime) +
                              "; a length: " + units_of(Field::kPosition) + "; a force: " + units_of(Field::kForce) +
                              "; a pressure: " + units_of(Field::kPressure));
    }
  }
  if (const auto positive = root.table_if("positive")) {
    for (const Field field : {Field::kPosition, Field::kForce})
      if (positive->has(name_of(field)))
        mapping.compression_positive[field] =
            positive->choice(name_of(field), {"tension", "compression"}) == "compression";
  }
  if (const auto specimen = root.table_if("specimen")) {
    if (specimen->has("name")) mapping.specimen = specimen->string("name");
    const auto number = [&](const char* key, std::optional<double>& to, base::Range range) {
      if (specimen->has(key)) to = specimen->number(key, range);
    };
    if (specimen->type_of("rest_length_mm") == "string")
      mapping.no_rest_length = specimen->choice("rest_length_mm", {"none"}) == "none";
    else
      number("rest_length_mm", mapping.rest_length_mm, kLength);
    number("pressurized_rest_length_mm", mapping.pressurized_rest_length_mm, kLength);
    number("nominal_pressure_psi", mapping.nominal_pressure_psi, {-1e3, 1e3});
    number("load_N", mapping.load_N, {-kMostLoad_N, kMostLoad_N});
    if (specimen->type_of("zero_mm") == "string")
      mapping.whole_length = specimen->choice("zero_mm", {kWholeLength}) == kWholeLength;
    else
      number("zero_mm", mapping.zero_mm, {-1e4, 1e4});
  }
  document.finish();
  return mapping;
}

std::string mapping_text(const Mapping& mapping) {
  std::string text = "# What `isorig import` was told of files like this one: isorig import --mapping THIS FILE...\n";
  text += "format = " + toml_string(kFormat) + "\n";
  if (mapping.dialect.delimiter)
    text += "delimiter = " + toml_string(delimiter_text(*mapping.dialect.delimiter)) + "\n";
  if (mapping.dialect.decimal) text += "decimal = \"" + std::string(1, *mapping.dialect.decimal) + "\"\n";
  if (mapping.output) text += "output = " + toml_string(messages::name_of(*mapping.output)) + "\n";
  if (!mapping.column.empty()) text += "\n[column]\n";
  for (const auto& [field, name] : mapping.column)
    text += std::string(name_of(field)) + " = " + toml_string(name) + "\n";
  if (!mapping.unit.empty()) text += "\n[unit]\n";
  for (const auto& [column, unit] : mapping.unit) text += toml_string(column) + " = " + toml_string(unit) + "\n";
  if (!mapping.compression_positive.empty()) text += "\n[positive]\n";
  for (const auto& [field, compression] : mapping.compression_positive)
    text += std::string(name_of(field)) + " = \"" + (compression ? "compression" : "tension") + "\"\n";
  // Without the specimen's name: the next file is of another one, and would be labelled with this one's.
  text += "\n[specimen]\n";
  const auto number = [&](const char* key, const std::optional<double>& value) {
    if (value) text += std::string(key) + " = " + toml_number(*value) + "\n";
  };
  if (mapping.no_rest_length) text += "rest_length_mm = \"none\"\n";
  number("rest_length_mm", mapping.rest_length_mm);
  number("pressurized_rest_length_mm", mapping.pressurized_rest_length_mm);
  number("nominal_pressure_psi", mapping.nominal_pressure_psi);
  number("load_N", mapping.load_N);
  if (mapping.whole_length) text += "zero_mm = " + toml_string(kWholeLength) + "\n";
  number("zero_mm", mapping.zero_mm);
  return text;
}

}  // namespace isorig::foreign
