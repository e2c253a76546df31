#pragma once
#include <exception>
#include <new>
#include <stdexcept>
#include <string>

#include "model/composed.hpp"

struct isorig_model {
  isorig::model::ModelSpec spec;
  std::string text;
};

/// What the functions of isorig_model.h have in common.
namespace isorig::c_abi {

/// isorig_model_error().
inline thread_local std::string last_error;

/// No exception may pass into C.
template <typename Call>
auto guarded(Call&& call, decltype(call()) failed) noexcept -> decltype(call()) {
  try {
    return call();
  } catch (const std::bad_alloc&) {
    last_error = "out of memory";
  } catch (const std::exception& e) {
    last_error = e.what();
  } catch (...) {
    last_error = "an unknown error";
  }
  return failed;
}

template <typename T>
void require(const T* pointer, const char* name) {
  if (pointer == nullptr) throw std::invalid_argument(std::string(name) + " is missing");
}

}  // namespace isorig::c_abi
