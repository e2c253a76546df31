#include "calibration/record.hpp"

#include <toml++/toml.h>

#include <cmath>
#include <sstream>

#include "base/blank.hpp"
#include "base/toml_reader.hpp"
#include "calibration/date.hpp"

namespace isorig::calibration {
namespace {

constexpr double kSameNumber = 1e-6;

toml::table to_table(const ForceClass& f) {
  toml::table t{{"class", f.text},
                {"error_percent", f.error_percent},
                {"resolution_percent", f.resolution_percent},
                {"series", f.series},
                {"levels", f.levels}};
  if (f.repeatability_percent) t.insert("repeatability_percent", *f.repeatability_percent);
  if (f.reversibility_percent) t.insert("reversibility_percent", *f.reversibility_percent);
  if (f.zero_percent) t.insert("zero_percent", *f.zero_percent);
  return t;
}

void plain_text(const base::TomlTable& table, const char* key, const std::string& text) {
  for (const char c : text) {
    if (static_cast<unsigned char>(c) < 0x20 || c == 0x7f) {
      table.error(key, std::string("`") + key + "` has control characters; write it as one plain line");
      return;
    }
  }
}

std::string date(const base::TomlTable& table, const char* key) {
  auto text = table.string(key);
  if (!text.empty() && !days_of(text)) {
    table.error(key, std::string("`") + key + "` = \"" + text + "\"; a date is written 2027-05-31");
  }
  return text;
}

}  // namespace

std::string record_id(const std::string& made_utc, Channel channel) {
  std::string id;
  for (const char c : made_utc) {
    if (c == 'T') id += '-';
    if (c >= '0' && c <= '9') id += c;
  }
  return id + "-" + name_of(channel);
}

std::string to_toml(const Record& r) {
  toml::array points;
  for (std::size_t i = 0; i < r.points.size(); ++i) {
    const auto& p = r.points[i];
    points.push_back(toml::table{{"reference", p.reference},
                                 {"raw", p.raw},
                                 {"standard_error", p.standard_error},
                                 {"drift", p.drift},
                                 {"as_found_error", r.result.as_found[i]},
                                 {"as_left_error", r.result.as_left[i]}});
  }
  toml::table uncertainty{{"expanded_k2", r.result.uncertainty}, {"scatter", r.result.scatter}};
  if (r.result.hysteresis) uncertainty.insert("hysteresis", *r.result.hysteresis);
  toml::table t{
      {"format", "isorig-calibration/1"},
      {"id", r.id},
      {"rig", r.rig},
      {"channel", name_of(r.channel)},
      {"unit", unit_of(r.channel)},
      {"mode", name_of(r.mode)},
      {"made_utc", r.made_utc},
      {"due", r.due},
      {"operator", r.operator_name},
      {"note", r.note},
      {"evidence_run", r.evidence_run},
      {"supersedes", r.supersedes},
      {"temperature_C", r.temperature_C},
      {"reference", toml::table{{"id", r.reference.id},
                                {"certificate", r.reference.certificate},
                                {"certificate_due", r.reference.certificate_due},
                                {"uncertainty_k2", r.reference.uncertainty}}},
      {"correction", toml::table{{"scale", r.result.correction.scale}, {"offset", r.result.correction.offset}}},
      {"before", toml::table{{"scale", r.before.scale}, {"offset", r.before.offset}}},
      {"as_found", toml::table{{"max_error", r.result.as_found_max}, {"within_error_band", r.result.found_in_band}}},
      {"as_left", toml::table{{"max_error", r.result.as_left_max}}},
      {"uncertainty", uncertainty},
      {"points", points},
  };
  // In the manner of ISO 7500-1: fit.hpp says what that leaves open.
  if (r.result.class_found) t.insert("iso_7500_1_like_as_found", to_table(*r.result.class_found));
  if (r.result.class_left) t.insert("iso_7500_1_like_as_left", to_table(*r.result.class_left));
  std::ostringstream out;
  out << t << '\n';
  return out.str();
}

Record parse_record(const std::string& text, const std::string& name) {
  const auto document = base::TomlDocument::parse_text(text, name);
  const auto root = document.root();
  (void)root.choice("format", {"isorig-calibration/1"});
  Record r;
  r.id = root.string("id");
  r.rig = root.string("rig");
  r.channel = channel_of(root.choice("channel", {"pressure", "force", "position"})).value_or(Channel::kPressure);
  if (root.string("unit") != unit_of(r.channel))
    root.error("unit", std::string("`unit` has to be \"") + unit_of(r.channel) + "\"");
  r.mode = mode_of(root.choice("mode", {"adjust", "zero", "check"})).value_or(Mode::kAdjust);
  r.made_utc = root.string("made_utc");
  if (r.made_utc.size() != 20 || !days_of(std::string_view(r.made_utc).substr(0, 10))) {
    root.error("made_utc", "`made_utc` is written 2026-11-21T07:15:00Z");
  } else if (r.id != record_id(r.made_utc, r.channel)) {
    root.error("id", "`id` has to be " + record_id(r.made_utc, r.channel) + ", after time and channel");
  }
  r.due = date(root, "due");
  r.operator_name = root.string("operator");
  if (base::is_blank(r.operator_name)) root.error("operator", "`operator` is empty; name who calibrated");
  r.note = root.string_or("note", "");
  r.evidence_run = root.string_or("evidence_run", "");
  r.supersedes = root.string_or("supersedes", "");
  for (const auto* key : {"operator", "note", "evidence_run", "supersedes"})
    plain_text(root, key, root.string_or(key, ""));
  r.temperature_C = root.number_or("temperature_C", 0.0);
  const auto reference = root.table("reference");
  r.reference.id = reference.string("id");
  if (base::is_blank(r.reference.id)) reference.error("id", "`id` is empty; name the reference instrument");
  r.reference.certificate = reference.string_or("certificate", "");
  r.reference.certificate_due = date(reference, "certificate_due");
  r.reference.uncertainty = reference.number("uncertainty_k2", base::kNonNegative);
  plain_text(reference, "id", r.reference.id);
  plain_text(reference, "certificate", r.reference.certificate);
  const auto pair = [&](const char* key) {
    const auto t = root.table(key);
    return Correction{t.number("scale", base::kPositive), t.number("offset")};
  };
  const Correction stated = pair("correction");
  r.before = pair("before");
  for (const auto& p : root.tables("points")) {
    r.points.push_back({p.number("reference"), p.number("raw"), p.number_or("standard_error", 0.0, base::kNonNegative),
                        p.number_or("drift", 0.0)});
    p.ignore_rest();
  }
  for (const auto* key :
       {"as_found", "as_left", "uncertainty", "iso_7500_1_like_as_found", "iso_7500_1_like_as_left"}) {
    if (const auto t = root.table_if(key)) t->ignore_rest();
  }
  if (document.diagnostics().empty()) {
    // The numbers follow from the points; a record that says otherwise was edited or damaged.
    try {
      r.result = calibrate(r.channel, r.mode, r.points, r.before, r.reference.uncertainty);
      const double size = std::max(1.0, std::abs(r.result.correction.offset));
      if (std::abs(stated.scale - r.result.correction.scale) > kSameNumber ||
          std::abs(stated.offset - r.result.correction.offset) > kSameNumber * size) {
        root.error("correction",
                   "the correction does not follow from the record's points; the file was changed after it was made");
      }
    } catch (const std::runtime_error& e) {
      root.error("points", e.what());
    }
  }
  document.finish();
  r.result.correction = stated;
  return r;
}

}  // namespace isorig::calibration
