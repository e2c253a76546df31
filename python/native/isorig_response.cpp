#include <limits>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

#include "c_abi.hpp"
#include "identify/response/response_model.hpp"
#include "isorig_model.h"
#include "messages/recording.hpp"
#include "rows.hpp"

struct isorig_response {
  isorig::identify::response::ResponseModel model;
};

namespace {

using namespace isorig;
using c_abi::check_rows, c_abi::guarded, c_abi::require;
namespace response = identify::response;

std::vector<double> copied(const double* from, std::size_t rows) {
  return from == nullptr ? std::vector<double>() : std::vector<double>(from, from + rows);
}

}  // namespace

extern "C" {

isorig_response* isorig_response_read(const char* file) {
  return guarded(
      [&] {
        require(file, "the file of the model");
        return new isorig_response{response::read_response_model(file)};
      },
      nullptr);
}

void isorig_response_free(isorig_response* model) {
  delete model;
}

const char* isorig_response_name(const isorig_response* model) {
  return model->model.name.c_str();
}

const char* isorig_response_output(const isorig_response* model) {
  return messages::name_of(model->model.output).data();  // a literal: it ends with a zero
}

double isorig_response_error(const isorig_response* model) {
  return model->model.error;
}

int isorig_response_predict(const isorig_response* model, const char* name, size_t rows, const double* t_s,
                            const double* position_mm, const double* force_N, size_t pressure_rows,
                            const double* pressure_t_s, const double* pressure_psi, double* value, double* low95,
                            double* high95) {
  return guarded(
      [&] {
        require(model, "the model");
        require(name, "the name of the recording");
        require(value, "the place for the answer");
        const response::ResponseModel& m = model->model;
        const bool of_pressure = m.output == messages::Output::kPressure;
        if ((of_pressure ? pressure_rows : rows) == 0) throw std::invalid_argument("there are no rows");
        messages::Recording recording;
        recording.metadata.output = m.output;
        if (rows > 0) {
          require(t_s, "t_s");
          require(position_mm, "position_mm");
          require(force_N, "force_N");
          check_rows(rows, {"t_s", t_s}, {{"position_mm", position_mm}, {"force_N", force_N}});
          recording.frame = {copied(t_s, rows), copied(position_mm, rows), copied(force_N, rows)};
        }
        if (pressure_t_s != nullptr) {
          require(pressure_psi, "pressure_psi");
          check_rows(pressure_rows, {"pressure_t_s", pressure_t_s}, {{"pressure_psi", pressure_psi}});
          recording.pressure = {copied(pressure_t_s, pressure_rows), copied(pressure_psi, pressure_rows)};
        }
        const response::Data data = response::data_for(recording, name, m);
        const std::vector<double> answer = response::simulate(m, data, response::begin_of(data));
        constexpr double kTwoSided95 = 1.96, kNotKnown = std::numeric_limits<double>::quiet_NaN();
        for (std::size_t i = 0; i < answer.size(); ++i) {
          value[i] = answer[i];
          if (low95 != nullptr) low95[i] = m.error > 0.0 ? answer[i] - kTwoSided95 * m.error : kNotKnown;
          if (high95 != nullptr) high95[i] = m.error > 0.0 ? answer[i] + kTwoSided95 * m.error : kNotKnown;
        }
        return 0;
      },
      -1);
}

}  // extern "C"
