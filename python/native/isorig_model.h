/* libisorig_model: a model.toml stepped from outside of isorig, by the arithmetic of `isorig predict` and of the
   simulated rig (model/, identify/diagnose/). For the Python package; any language that calls C may use it.

   Sign and frame: extension and tension positive, position relative to the unpressurized rest length, pressure gauge.
   Lengths mm, forces N, pressures psi, times s. NaN stands for "not stated" where a comment says so.

   A function that returns a pointer returns NULL when it fails, one that returns int returns 0 when it succeeds.
   isorig_model_error() then says what is wrong and what to do, in the words of the command line. Handles may be used
   from one thread at a time; the text of an error belongs to the thread. */
#ifndef ISORIG_MODEL_H
#define ISORIG_MODEL_H
#include <stddef.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

#define ISORIG_MODEL_ABI 2
/* ISORIG_MODEL_ABI of the library that was loaded. */
int isorig_model_abi(void);
/* Of isorig: "0.1.0". */
const char* isorig_model_version(void);
/* Of the last call that failed in this thread; valid until the next call. */
const char* isorig_model_error(void);

typedef struct isorig_model isorig_model;
/* TOML ("isorig-model/1"); `name` stands in its errors. */
isorig_model* isorig_model_parse(const char* toml, const char* name);
/* "slse1" or "slse2", with starting values. */
isorig_model* isorig_model_nominal(const char* name);
isorig_model* isorig_model_copy(const isorig_model* model);
void isorig_model_free(isorig_model* model);
/* TOML of the model as it stands; belongs to the model, valid until its next call. */
const char* isorig_model_text(isorig_model* model);
const char* isorig_model_name(const isorig_model* model);
/* Nonzero when it states what it was fitted to ([seen]): predictions then have a band. */
int isorig_model_has_band(const isorig_model* model);

/* One number of a model: a parameter enters nonlinearly, a coefficient multiplies a force. */
typedef struct {
  int64_t part;         /* counted from 0, as the [[part]] stand in the file */
  const char* physics;  /* "spring", "coulomb_friction", ... */
  const char* law;
  const char* name;  /* with its unit: "tau_s" */
  const char* what;  /* a sentence; "" where there is none */
  double value;
  double lower;  /* the range that the law is meant for; infinite where there is no bound */
  double upper;
  int32_t coefficient;  /* nonzero: the force is linear in it (but where a law says otherwise) */
  int32_t fixed;        /* nonzero: given, not identified */
} isorig_number;
size_t isorig_model_number_count(const isorig_model* model);
int isorig_model_number(const isorig_model* model, size_t index, isorig_number* out);
/* Outside of its range it is refused. */
int isorig_model_set(isorig_model* model, size_t index, double value);

/* Of recording.toml. NaN: not stated, as in a recording of what is no McKibben. */
typedef struct {
  double rest_length_mm;
  double pressurized_rest_length_mm;
  double nominal_pressure_psi;
} isorig_specimen;

/* What drives a model: motion and pressure of a recording, reconstructed from their noisy readings. `pressure_t_s` may
   be NULL. */
typedef struct isorig_drive isorig_drive;
isorig_drive* isorig_drive_new(const isorig_specimen* specimen, size_t rows, const double* t_s,
                               const double* position_mm, size_t pressure_rows, const double* pressure_t_s,
                               const double* pressure_psi);
void isorig_drive_free(isorig_drive* drive);
/* `force_N`: what was read, one for each row. A model knows by it the recording that it was made from, whose slips it
   then predicts; nothing else is made of it. */
int isorig_drive_was_read_with(isorig_drive* drive, const double* force_N);

/* What `isorig predict` does to a recording: the model is stepped on its drive, and fades to its nominal model outside of
   what it has seen. `low95_N`, `high95_N` and `outside` (1 where the model leaves what it has seen) may be NULL; without
   a band they are filled with NaN. Each has the `rows` of the drive. */
int isorig_model_predict(const isorig_model* model, const isorig_drive* drive, double* force_N, double* low95_N,
                         double* high95_N, double* outside);
/* What the last prediction of this thread left of the ranges of its model, a line each; "" for nothing. */
const char* isorig_model_notes(void);

/* What makes it doubtful that lengths are in millimetres (docs/data.md), for people; "" for nothing, valid until the
   next call of this thread. */
const char* isorig_unit_in_doubt(const isorig_specimen* specimen, size_t rows, const double* position_mm);

/* A model that runs on a motion that is known: between two calls position and pressure are taken to change evenly. No
   noise is looked for, and nothing fades. */
typedef struct isorig_stepper isorig_stepper;
isorig_stepper* isorig_stepper_new(const isorig_model* model, const isorig_specimen* specimen);
void isorig_stepper_free(isorig_stepper* stepper);
/* `t_s` increases from call to call. `pressure_psi` may be NULL: the pressure is the nominal one. After a failure
   nothing of this call has happened. */
int isorig_stepper_run(isorig_stepper* stepper, size_t rows, const double* t_s, const double* position_mm,
                       const double* pressure_psi, double* force_N);

/* A model of positions or pressures: model.toml of a diagnosis of such recordings ("isorig-response/1"). */
typedef struct isorig_response isorig_response;
isorig_response* isorig_response_read(const char* file);
void isorig_response_free(isorig_response* model);
const char* isorig_response_name(const isorig_response* model);
/* What it answers with: "position" (mm) or "pressure" (psi). */
const char* isorig_response_output(const isorig_response* model);
/* Rms of readings that were left out of its fit, in the output's unit; 0: not known. */
double isorig_response_error(const isorig_response* model);
/* What `isorig predict` does to a recording of this output, whose readings are looked at for the beginning alone. `name`
   stands in errors. `rows` are those of the frame (0: none), `pressure_t_s` may be NULL. `value`, `low95` and `high95`
   have the rows of the output: the frame's of a position, the pressure's of a pressure. The last two may be NULL; without
   a known error they are filled with NaN. */
int isorig_response_predict(const isorig_response* model, const char* name, size_t rows, const double* t_s,
                            const double* position_mm, const double* force_N, size_t pressure_rows,
                            const double* pressure_t_s, const double* pressure_psi, double* value, double* low95,
                            double* high95);

/* Reads a run's directory, or one segment. `outcome`: what the catalogue has of it ("done", ...), "" where there is none;
   `still_written`: nonzero while a recorder holds it. `state`: 0 whole, 1 incomplete, 2 interrupted, 3 damaged
   (docs/data.md). */
int isorig_run_state(const char* path, const char* outcome, int still_written, int* state);
/* What the last isorig_run_state() of this thread found wrong, a line each. */
const char* isorig_run_complaints(void);

/* The steps that a protocol is compiled to, as a run carries them out. */
typedef struct isorig_plan isorig_plan;
typedef struct {
  const char* kind; /* "pressurize", "settle", "ramp", "hold", "wave", "mark" */
  const char* text; /* the step in words; valid until the plan's next call */
  double from_mm;   /* planned position before it */
  double to_mm;     /* and after it */
  double velocity_mm_s; /* of a ramp, extension positive; of a wave its peak; 0 of what does not move */
  double pressure_psi;  /* set-point */
} isorig_step;
/* TOML ("isorig-protocol/1"); `name` stands in its errors. */
isorig_plan* isorig_plan_new(const char* toml, const char* name);
void isorig_plan_free(isorig_plan* plan);
size_t isorig_plan_count(const isorig_plan* plan);
int isorig_plan_step(isorig_plan* plan, size_t index, isorig_step* out);

/* CRC-32C, as in the recordings of isorig (docs/data.md). */
uint32_t isorig_crc32c(const uint8_t* bytes, size_t count, uint32_t before);

#ifdef __cplusplus
}
#endif
#endif
