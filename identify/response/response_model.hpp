#pragma once
#include <filesystem>
#include <string>
#include <vector>

#include "identify/response/response_data.hpp"

namespace isorig::identify::response {

inline constexpr double kHour_s = 3600.0;

/// How one column answers to others, as a compliance with retardation times (Kelvin-Voigt units in series with a
/// spring; Findley, Lai & Onaran 1976, ch. 5; Ferry 1980, ch. 3). With inputs u_j that vary (pressure, load):
///
///     y(t) = y0 + sum_j [ S_j du_j + g_j P_j + sum_i C_ij (du_j - z_ij) ] + d (t - t0)
///     z_ij' = u_j' - z_ij / T_i,  z_ij(t0) = 0,  du_j = u_j(t) - u_j(t0)
///
/// S_j is the immediate answer per unit of input, C_ij the one that comes with the retardation time T_i; both have the
/// sign of the whole answer, as a passive specimen's have. P_j is the play operator of width w_j on the input (Visintin
/// 1994): a hysteresis that does not depend on the rate. Exact for inputs that are straight between rows.
///
/// Without an input that varies (a leak, a filling, a creep under constant load) the answer settles to `rest`:
///
///     y(t) = rest + (y0 - rest) sum_i f_i exp(-(t - t0) / T_i),  sum_i f_i = 1
///
/// or, where outflow is not in proportion to what is left, q' = -q |q / q_r|^(n-1) / T_1 with q = y - rest and a scale
/// q_r. With q0 = y0 - rest and T = T_1 |q0 / q_r|^(1-n):
///
///     q(t) = q0 [1 + (n - 1) (t - t0) / T]^(-1 / (n - 1)),  zero from where the bracket is (n < 1)
///
/// (an orifice has n = 1/2, a laminar leak n = 1, a laminar leak of a gas far above the pressure outside n = 2).
struct ResponseModel {
  std::string name;
  messages::Output output = messages::Output::kPosition;
  struct Input {
    std::string column;
    double immediate = 0.0;        ///< S_j, output's unit per the column's
    std::vector<double> retarded;  ///< C_ij, one for each time
    double play_width = 0.0;       ///< w_j, the column's unit; 0: no play
    double play_gain = 0.0;        ///< g_j
  };
  std::vector<double> times_s;  ///< T_i, increasing
  std::vector<Input> inputs;    ///< empty: settles to `rest`
  double drift_per_h = 0.0;     ///< d, output's unit per hour
  double rest = 0.0;            ///< without inputs
  std::vector<double> shares;   ///< f_i, without inputs
  double exponent = 1.0;        ///< n, without inputs and with one time
  double scale = 1.0;           ///< q_r, of an exponent other than 1
  double error = 0.0;           ///< rms of readings left out of the fit; 0: not known
};

/// The answer from `y0` on, at the rows of `of`.
[[nodiscard]] std::vector<double> simulate(const ResponseModel& model, const Data& of, double y0);

/// The recording with the inputs that the model answers to. Throws std::invalid_argument where one is not there, and
/// where the model answers to nothing and a column drives the recording.
[[nodiscard]] Data data_for(const messages::Recording& recording, std::string name, const ResponseModel& model);

/// Where a prediction begins: at the first row of a straight line through the readings within 1 % of the recording's
/// time of the first (at most ten; the first reading where there are fewer than three). A prediction looks at no other
/// reading of the output.
[[nodiscard]] double begin_of(const Data& data);

/// "isorig-response/1". Throws base::ConfigError with every fault.
[[nodiscard]] ResponseModel read_response_model(const std::filesystem::path& file);
[[nodiscard]] std::string response_model_text(const ResponseModel& model, std::string_view comment);
/// The file says so at its beginning; false also for what cannot be read.
[[nodiscard]] bool is_response_model(const std::filesystem::path& file);

}  // namespace isorig::identify::response
