#include "isorig_model.h"

#include <cmath>
#include <limits>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

#include "base/number_text.hpp"
#include "c_abi.hpp"
#include "identify/diagnose/fit/free_parameters.hpp"
#include "identify/diagnose/fit/running_forecast.hpp"

namespace {

using namespace isorig;
using c_abi::guarded, c_abi::last_error, c_abi::require;

std::vector<identify::FreeNumber> numbers_of(const model::ModelSpec& spec) {
  std::vector<identify::FreeNumber> numbers;
  for (std::size_t p = 0; p < spec.parts.size(); ++p) {
    for (std::size_t i = 0; i < spec.parts[p].parameters.size(); ++i) numbers.push_back({p, i, false});
    for (std::size_t i = 0; i < spec.parts[p].coefficients.size(); ++i) numbers.push_back({p, i, true});
  }
  return numbers;
}

identify::FreeNumber number_at(const model::ModelSpec& spec, std::size_t index) {
  const auto numbers = numbers_of(spec);
  if (index >= numbers.size())
    throw std::out_of_range("the model has " + std::to_string(numbers.size()) +
                            " numbers, counted from 0; there is no " + std::to_string(index));
  return numbers[index];
}

isorig_number described(const model::ModelSpec& spec, const identify::FreeNumber& number) {
  constexpr double kEndless = std::numeric_limits<double>::infinity();
  const model::Part& part = spec.parts[number.part];
  // Names are literals of the catalogue: each ends with a zero.
  isorig_number out{.part = static_cast<std::int64_t>(number.part),
                    .physics = part.physics->name.data(),
                    .law = part.law->name.data(),
                    .name = "",
                    .what = "",
                    .value = identify::value_of(spec, number),
                    .lower = -kEndless,
                    .upper = kEndless,
                    .coefficient = number.coefficient ? 1 : 0,
                    .fixed = part.fixed ? 1 : 0};
  const model::NumberSheet* sheet = nullptr;
  if (number.coefficient) {
    const auto& c = part.law->coefficients[number.index];
    out.name = c.name.data();
    sheet = &c.sheet;
    if (c.sign == model::Sign::kNonNegative) out.lower = 0.0;
    if (c.sign == model::Sign::kNonPositive) out.upper = 0.0;
  } else {
    const auto& p = part.law->parameters[number.index];
    out.name = p.name.data();
    sheet = &p.sheet;
    out.lower = p.lower;
    out.upper = p.upper;
    out.fixed = part.fixed || p.fixed ? 1 : 0;
  }
  if (!sheet->what.empty()) out.what = sheet->what.data();
  return out;
}

}  // namespace

extern "C" {

const char* isorig_model_error(void) {
  return last_error.c_str();
}

int isorig_model_abi(void) {
  return ISORIG_MODEL_ABI;
}

const char* isorig_model_version(void) {
  return ISORIG_VERSION;
}

isorig_model* isorig_model_parse(const char* toml, const char* name) {
  return guarded(
      [&] {
        require(toml, "the text of the model");
        require(name, "its name");
        auto spec = model::parse_model(toml, name);
        if (const std::string why = identify::unfit_seen(spec); !why.empty())
          throw std::invalid_argument(std::string(name) + ": " + why);
        return new isorig_model{std::move(spec), {}};
      },
      nullptr);
}

isorig_model* isorig_model_nominal(const char* name) {
  return guarded(
      [&] {
        require(name, "the model's name");
        auto spec = model::nominal_model(name);
        if (spec.parts.empty())
          throw std::invalid_argument("there is no nominal model \"" + std::string(name) +
                                      "\"; there are slse1, slse2");
        return new isorig_model{std::move(spec), {}};
      },
      nullptr);
}

isorig_model* isorig_model_copy(const isorig_model* model) {
  return guarded(
      [&] {
        require(model, "the model");
        return new isorig_model(*model);
      },
      nullptr);
}

void isorig_model_free(isorig_model* model) {
  delete model;
}

const char* isorig_model_text(isorig_model* model) {
  return guarded(
      [&]() -> const char* {
        require(model, "the model");
        model->text = model::model_text(model->spec);
        return model->text.c_str();
      },
      nullptr);
}

const char* isorig_model_name(const isorig_model* model) {
  return model->spec.name.c_str();
}

int isorig_model_has_band(const isorig_model* model) {
  return model->spec.seen ? 1 : 0;
}

size_t isorig_model_number_count(const isorig_model* model) {
  return guarded([&] { return numbers_of(model->spec).size(); }, std::size_t{0});
}

int isorig_model_number(const isorig_model* model, size_t index, isorig_number* out) {
  return guarded(
      [&] {
        require(model, "the model");
        require(out, "the place for the number");
        *out = described(model->spec, number_at(model->spec, index));
        return 0;
      },
      -1);
}

int isorig_model_set(isorig_model* model, size_t index, double value) {
  return guarded(
      [&] {
        require(model, "the model");
        const auto number = number_at(model->spec, index);
        const isorig_number about = described(model->spec, number);
        if (!std::isfinite(value) || value < about.lower || value > about.upper)
          throw std::invalid_argument(std::string(about.physics) + "." + about.name + " is " +
                                      base::number_text(value, 6) + "; it lies between " +
                                      base::number_text(about.lower, 6) + " and " + base::number_text(about.upper, 6));
        identify::value_of(model->spec, number) = value;
        return 0;
      },
      -1);
}

}  // extern "C"
