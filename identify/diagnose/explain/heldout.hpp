#pragma once
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "identify/diagnose/explain/pictured.hpp"
#include "identify/diagnose/fit/left_out.hpp"

namespace isorig::identify {

/// Bins of one kind left out of the fit and predicted by both models.
struct LeftOut {
  std::string by;     ///< velocity, amplitude, waveform, recording; block
  std::string value;  ///< "8 mm/s", "4 mm", "ramp", the recording's name; "" of the blocks
  double readings = 0.0;
  double nominal_rmse_N = 0.0;
  double model_rmse_N = 0.0;
  double more_N2 = 0.0;        ///< squares of the model minus those of the nominal model, summed over the readings
  double more_error_N2 = 0.0;  ///< standard error of that sum, by how the strokes (blocks) disagree; 0 for a single one
  std::size_t strokes = 0;     ///< that it rests on
  double learning_N2 = 0.0;    ///< of more_N2, what noise in the model's numbers is expected to make (left_out.hpp)
};

/// The range of a number of the model over all these fits. A number that depends on a single motion is no property of
/// the specimen.
struct Stability {
  std::string parameter;  ///< "coulomb_friction.force_N"
  double value = 0.0;     ///< from everything
  double lowest = 0.0;
  double highest = 0.0;
};

struct HeldoutStudy {
  BlockKind blocks = BlockKind::kNone;
  std::optional<LeftOut> all;     ///< a quarter of the blocks at a time; empty where nothing can be left out
  std::vector<LeftOut> left_out;  ///< one kind of motion, or one recording, at a time
  std::vector<Stability> stability;
  std::vector<BlockError> each_block;   ///< of `all`, in the order of time
  std::vector<LeftOutStretch> to_draw;  ///< the worst and the median of `each_block`, then of `left_out`
};

/// Leaves bins out, has models fitted to the others, and compares their predictions. Those of the nominal model are
/// computed once.
///
/// Blocks (fit/blocks.hpp), a quarter at a time. Moves by their largest velocity, by their range and by their waveform,
/// and whole recordings: where there are several of a kind each is left out in turn, at most five of a kind.
class LeaveOut {
 public:
  /// `white_N`: of a reading (Prediction::rmse_N). `nominal` learns the nominal model.
  LeaveOut(std::span<const Series> series, double white_N, const Learner& nominal, unsigned threads);
  ~LeaveOut();
  LeaveOut(const LeaveOut&) = delete;
  LeaveOut& operator=(const LeaveOut&) = delete;

  /// What is left out, as a model predicts it.
  struct Predictions {
    std::vector<Prediction> blocks, kinds;
    std::vector<double> learning_N2;  ///< of each kind (LeftOut)
  };
  /// `noise` that the model is learnt under.
  [[nodiscard]] Predictions predict(const Learner& learner, const NoiseModel& noise) const;
  /// `model` with the numbers that it has from everything; `share` of what it has beyond the nominal model is
  /// predicted.
  [[nodiscard]] HeldoutStudy study(const model::ModelSpec& model, const Predictions& predictions,
                                   double share = 1.0) const;
  [[nodiscard]] HeldoutStudy study(const model::ModelSpec& model, const Learner& learner,
                                   const NoiseModel& noise) const {
    return study(model, predict(learner, noise));
  }
  /// The nominal model against itself.
  [[nodiscard]] HeldoutStudy study_of_nominal(const model::ModelSpec& nominal) const;

 private:
  struct Cached;
  [[nodiscard]] std::vector<Prediction> predict_kinds(const Learner& learner) const;
  [[nodiscard]] HeldoutStudy compared(const model::ModelSpec& model, const std::vector<Prediction>& blocks,
                                      const std::vector<Prediction>& kinds) const;

  std::span<const Series> series_;
  double white_N_;
  unsigned threads_;
  std::unique_ptr<Cached> cached_;
};

}  // namespace isorig::identify
