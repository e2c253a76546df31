#include "daemon/host/diagnoses.hpp"

#include <algorithm>
#include <chrono>
#include <ctime>
#include <functional>
#include <iterator>
#include <map>
#include <stdexcept>
#include <utility>

#include "base/beneath.hpp"
#include "base/fingerprint.hpp"
#include "base/json_words.hpp"
#include "base/printable.hpp"
#include "base/report_pages.hpp"
#include "base/utc_text.hpp"
#include "daemon/host/not_there.hpp"

namespace isorig::daemon {
namespace {

using nlohmann::json;

constexpr int kDepth = 3;
constexpr std::size_t kDocumentBytes = std::size_t{8} << 20U;
constexpr std::size_t kProtocolBytes = std::size_t{1} << 20U;
/// Of isorig's own documents some ten. Copying and writing JSON recurse, and who may write the folder may nest it
/// deeper than a stack is.
constexpr int kDeepestDocument = 64;
constexpr std::size_t kLongestPath = 4096;
/// The pages of an investigation's rounds lie up to three folders below it.
constexpr std::ptrdiff_t kPageDepth = kDepth + 3;

std::int64_t unix_s(std::filesystem::file_time_type time) {
  const auto system = std::chrono::file_clock::to_sys(time);
  return std::chrono::duration_cast<std::chrono::seconds>(system.time_since_epoch()).count();
}

/// Throws std::runtime_error with the file's name. Operators may write there, and this process may read what they may
/// not: no link that appears between a look and the reading leads out of `place`.
std::string bounded_text(const std::filesystem::path& place, const std::filesystem::path& file,
                         std::size_t most_bytes) {
  auto text = base::read_text_beneath(place, file.lexically_relative(place), most_bytes + 1);
  if (text.size() > most_bytes) {
    throw std::runtime_error(file.string() + " is longer than " + std::to_string(most_bytes >> 20U) +
                             " MiB: open it where it lies");
  }
  return text;
}

json document_of(const std::filesystem::path& place, const std::filesystem::path& file, const char* format) {
  try {
    auto out = json::parse(bounded_text(place, file, kDocumentBytes), [&](int depth, json::parse_event_t, const json&) {
      if (depth > kDeepestDocument) {
        throw std::runtime_error(file.string() + " is nested deeper than " + std::to_string(kDeepestDocument) +
                                 " levels");
      }
      return true;
    });
    if (!out.is_object() || out.value("format", "") != format) {
      throw std::runtime_error(std::string("it is no ") + format);
    }
    return out;
  } catch (const json::exception& e) {
    throw std::runtime_error(file.string() + ": " + base::json_words(e));
  }
}

/// The shapes that whoever shows a list relies on: one wrong file among a hundred, by hand or of another program, must
/// not take the others away. A number may be null, which JSON has for one that is not finite. Throws
/// std::runtime_error.
class Shape {
 public:
  using Check = std::function<void(const json&, const std::string& where)>;

  static void text(const json& value, const std::string& where) { require(value.is_string(), where, "a text"); }
  static void number(const json& value, const std::string& where) {
    require(value.is_number() || value.is_null(), where, "a number");
  }
  static void flag(const json& value, const std::string& where) { require(value.is_boolean(), where, "true or false"); }
  static void interval(const json& value, const std::string& where) {
    require(value.is_array() && value.size() == 2, where, "two numbers");
    each(number)(value, where);
  }
  static Check each(Check check) {
    return [check = std::move(check)](const json& value, const std::string& where) {
      require(value.is_array(), where, "a list");
      for (std::size_t i = 0; i < value.size(); ++i) check(value[i], where + "[" + std::to_string(i) + "]");
    };
  }
  static Check named(Check check) {
    return [check = std::move(check)](const json& value, const std::string& where) {
      require(value.is_object(), where, "an object");
      for (const auto& [name, one] : value.items()) check(one, where + "." + name);
    };
  }
  static Check or_null(Check check) {
    return [check = std::move(check)](const json& value, const std::string& where) {
      if (!value.is_null()) check(value, where);
    };
  }
  /// Keys of which the ones in `optional` may be missing; others are not looked at.
  static Check object(std::map<std::string, Check> needed, std::map<std::string, Check> optional = {}) {
    return [needed = std::move(needed), optional = std::move(optional)](const json& value, const std::string& where) {
      require(value.is_object(), where, "an object");
      const auto inside = [&](const std::string& key) { return where.empty() ? key : where + "." + key; };
      for (const auto& [key, check] : needed) {
        require(value.contains(key), inside(key), "there");
        check(value[key], inside(key));
      }
      for (const auto& [key, check] : optional)
        if (value.contains(key)) check(value[key], inside(key));
    };
  }

 private:
  static void require(bool is_so, const std::string& where, const char* what) {
    if (!is_so) throw std::runtime_error("`" + base::printable(where) + "` has to be " + what);
  }
};

const Shape::Check& shape_of_diagnosis() {
  static const auto parameter = Shape::object({{"value", Shape::number}, {"ci95", Shape::interval}});
  static const Shape::Check shape = Shape::object(
      {},
      {{"verdict", Shape::text},
       {"cannot_judge", Shape::or_null(Shape::object({{"why", Shape::text}, {"record", Shape::text}}))},
       {"missing", Shape::each(Shape::object(
                       {{"effect", Shape::text}, {"probability", Shape::number}},
                       {{"law", Shape::text}, {"size_N", Shape::number}, {"parameters", Shape::named(parameter)}}))},
       {"discernible", Shape::each(Shape::object({{"effect", Shape::text}}, {{"seen_from_N", Shape::number},
                                                                             {"nearest", Shape::or_null(Shape::text)},
                                                                             {"told_from_N", Shape::number}}))},
       {"alternatives",
        Shape::each(Shape::object({{"effects", Shape::each(Shape::text)}, {"probability", Shape::number}}))},
       {"inseparable", Shape::each(Shape::object({{"text", Shape::text}}))},
       {"not_modelled", Shape::or_null(Shape::object({{"names", Shape::each(Shape::text)}, {"why", Shape::text}}))},
       {"described", Shape::or_null(Shape::object({{"function_of", Shape::text}}))},
       {"warnings", Shape::each(Shape::text)},
       {"notes", Shape::each(Shape::text)},
       {"data_faults", Shape::each([](const json&, const std::string&) {})},
       {"next_experiment",
        Shape::or_null(Shape::object(
            {{"text", Shape::text}, {"duration_s", Shape::number}},
            {{"name", Shape::text}, {"reaches_it", Shape::flag}, {"separates", Shape::each(Shape::text)}}))}});
  return shape;
}

const Shape::Check& shape_of_investigation() {
  static const auto explanation = Shape::object({{"effects", Shape::text}, {"probability", Shape::number}});
  static const Shape::Check shape =
      Shape::object({{"outcome", Shape::text},
                     {"text", Shape::text},
                     {"rounds", Shape::each(Shape::object({}, {{"explanations", Shape::each(explanation)}}))}});
  return shape;
}

/// Of a diagnosis what a list shows: everything but curves and the table of what was tried.
json summary_of(const json& diagnosis) {
  shape_of_diagnosis()(diagnosis, "");
  json out;
  for (const char* key : {"verdict", "cannot_judge", "alternatives", "inseparable", "not_modelled", "described",
                          "unexplained_share", "fit", "warnings", "notes", "next_experiment"}) {
    if (diagnosis.contains(key)) out[key] = diagnosis[key];
  }
  out["missing"] = json::array();
  for (auto missing : diagnosis.value("missing", json::array())) {
    missing.erase("shape");
    for (const auto& able : diagnosis.value("discernible", json::array())) {
      if (able.value("effect", "") == missing.value("effect", "")) missing["discernible"] = able;
    }
    out["missing"].push_back(std::move(missing));
  }
  out["data_faults"] = diagnosis.value("data_faults", json::array()).size();
  return out;
}

/// Whose shape is wrong is said by the file's name.
template <typename Check>
void with_its_name(const std::filesystem::path& file, Check check) {
  try {
    check();
  } catch (const std::runtime_error& e) {
    throw std::runtime_error(file.string() + ": " + e.what());
  }
}

bool is_file(const std::filesystem::path& path) {
  std::error_code ignored;
  return std::filesystem::symlink_status(path, ignored).type() == std::filesystem::file_type::regular;
}

std::filesystem::path without_links(const std::filesystem::path& place) {
  std::error_code error;
  auto out = std::filesystem::canonical(place, error);
  return error ? place : out;
}

/// Of a path relative to a place: nothing in it leads out, is hidden, or is too deep.
bool leads_in(const std::filesystem::path& relative) {
  return !relative.empty() && std::distance(relative.begin(), relative.end()) <= kPageDepth + 1 &&
         std::ranges::none_of(relative, [](const auto& part) { return part.empty() || part.string().front() == '.'; });
}

struct Page {
  std::string title;
  std::filesystem::path file;
};

/// An investigation's own page, and the diagnosis of its last round; a diagnosis has one.
std::vector<Page> pages_of(const std::filesystem::path& folder, bool investigation, std::size_t rounds) {
  std::vector<Page> out;
  const auto add = [&](const char* title, const std::filesystem::path& file) {
    if (is_file(file)) out.push_back({title, file});
  };
  if (investigation) {
    add("Investigation", folder / "investigation-report.html");
    if (rounds > 0) {
      add("Diagnosis", folder / ("round-" + std::to_string(rounds)) / "diagnosis" / "diagnosis-report.html");
    }
  } else {
    add("Diagnosis", folder / "diagnosis-report.html");
  }
  return out;
}

}  // namespace

Diagnoses::Diagnoses(const std::vector<std::filesystem::path>& places, std::size_t entries) : entries_(entries) {
  for (const auto& place : places) {
    auto whole = std::filesystem::absolute(place).lexically_normal();
    if (!whole.has_filename()) whole = whole.parent_path();
    if (std::ranges::find(places_, whole) == places_.end()) places_.push_back(std::move(whole));
  }
}

std::filesystem::path Diagnoses::Found::document() const {
  return folder / (investigation ? "investigation.json" : "diagnosis.json");
}

void Diagnoses::look_into(const std::filesystem::path& place, const std::filesystem::path& folder, int depth,
                          Look& look, std::size_t& left) const {
  for (const bool investigation : {true, false}) {
    Found found{place, folder, investigation, {}};
    if (!is_file(found.document())) continue;
    std::error_code error;
    found.made = std::filesystem::last_write_time(found.document(), error);
    if (!error) look.found.push_back(std::move(found));
    if (investigation) return;
    break;
  }
  if (depth == kDepth) return;
  std::error_code error;
  for (std::filesystem::directory_iterator at(folder, error), end; !error && at != end; at.increment(error)) {
    if (left == 0) {
      look.cut = true;
      return;
    }
    --left;
    std::error_code ignored;
    if (at->symlink_status(ignored).type() == std::filesystem::file_type::directory) {
      look_into(place, at->path(), depth + 1, look, left);
    }
  }
}

Diagnoses::Look Diagnoses::look() const {
  Look out;
  for (const auto& place : places_) {
    std::size_t left = entries_;  // for each: many runs do not hide the folder of the diagnoses
    look_into(place, place, 0, out, left);
  }
  // One place may lie in another.
  std::ranges::sort(out.found, {}, &Found::folder);
  const auto again = std::unique(out.found.begin(), out.found.end(),
                                 [](const Found& a, const Found& b) { return a.folder == b.folder; });
  out.found.erase(again, out.found.end());
  std::ranges::stable_sort(out.found, std::ranges::greater(), &Found::made);
  return out;
}

json Diagnoses::list() const {
  auto looked = look();
  const auto all = looked.found.size();
  if (looked.found.size() > kListed) looked.found.resize(kListed);
  json out = json::array();
  for (const Found& f : looked.found) {
    json entry{{"id", base::fingerprint(f.folder.string())},
               {"folder", f.folder.lexically_relative(f.place).generic_string()},
               {"path", f.folder.string()},
               {"kind", f.investigation ? "investigation" : "diagnosis"},
               {"made_utc", base::utc_text(unix_s(f.made))},
               {"pages", json::array()},
               {"experiment", false}};
    try {
      std::size_t rounds = 0;
      if (f.investigation) {
        const auto whole = document_of(f.place, f.document(), "isorig-investigation/1");
        with_its_name(f.document(), [&] { shape_of_investigation()(whole, ""); });
        const auto& list = whole.at("rounds");
        rounds = list.size();
        for (const char* key : {"outcome", "text", "rig_s"}) entry[key] = whole.at(key);
        entry["rounds"] = rounds;
        if (rounds > 0) {
          const auto& last = list.back();
          entry["explanations"] = last.value("explanations", json::array());
          entry["experiment"] = last.contains("next_protocol");
        }
      } else {
        entry["experiment"] = is_file(f.folder / "next_experiment.toml");
      }
      for (const auto& page : pages_of(f.folder, f.investigation, rounds)) {
        entry["pages"].push_back({{"title", page.title}, {"path", page.file.string()}});
      }
      if (const auto file = f.folder / "diagnosis.json"; is_file(file)) {
        const auto whole = document_of(f.place, file, "isorig-diagnosis/1");
        with_its_name(file, [&] { entry.update(summary_of(whole)); });
      }
    } catch (const json::exception& e) {
      entry["wrong"] = f.document().string() + ": " + base::json_words(e);
    } catch (const std::exception& e) {
      entry["wrong"] = e.what();
    }
    out.push_back(std::move(entry));
  }
  json places = json::array();
  for (const auto& place : places_) places.push_back(place.string());
  return {{"diagnoses", std::move(out)}, {"all", all}, {"places", std::move(places)}, {"cut", looked.cut}};
}

json Diagnoses::page(const std::string& path) const {
  const std::filesystem::path file = path;
  if (path.size() < kLongestPath && path.find('\0') == std::string::npos && file.is_absolute() &&
      file.lexically_normal() == file && base::is_report_page(file.filename().string())) {
    for (const auto& place : places_) {
      for (const auto& root : {place, without_links(place)}) {  // reports link to each other by canonical paths
        const auto relative = file.lexically_relative(root);
        if (!leads_in(relative)) continue;
        try {
          return {{"page", bounded_text(root, root / relative, kPageBytes)}};
        } catch (const base::FileError& e) {
          if (!e.missing()) throw;
        }
      }
    }
  }
  throw NotThere(
      "there is no such page among the runs and the diagnoses (any more); look at their lists again. "
      "A report that lies elsewhere is opened where it lies");
}

json Diagnoses::experiment(const std::string& id) const {
  for (const Found& f : look().found) {
    if (base::fingerprint(f.folder.string()) != id) continue;
    if (!f.investigation) {
      const auto file = f.folder / "next_experiment.toml";
      if (!is_file(file)) break;
      return {{"protocol", bounded_text(f.place, file, kProtocolBytes)}, {"folder", f.folder.string()}};
    }
    const auto whole = document_of(f.place, f.document(), "isorig-investigation/1");
    const auto& rounds = whole.at("rounds");
    if (rounds.empty() || !rounds.back().contains("next_protocol")) break;
    return {{"protocol", rounds.back().at("next_protocol").get<std::string>()}, {"folder", f.folder.string()}};
  }
  throw NotThere("this diagnosis proposes no experiment (any more); look at the list of diagnoses again");
}

}  // namespace isorig::daemon
