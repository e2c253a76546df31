#pragma once
#include <gtest/gtest.h>

#include <utility>

#include "drivers/api/error.hpp"

namespace isorig::test {

/// The error that a call ends with; a failure of the test where it ends without.
template <class Call>
drivers::DeviceError error_of(Call&& call) {
  try {
    std::forward<Call>(call)();
  } catch (const drivers::DeviceError& error) {
    return error;
  }
  ADD_FAILURE() << "no DeviceError";
  return {drivers::Fault::kProtocol, ""};
}

}  // namespace isorig::test
