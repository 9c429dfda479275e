#pragma once
// Handles of libhdf5 that close themselves, and its errors as text, where the build has it.
#include <filesystem>

#include "evmarker/io/recording_error.hpp"

#ifdef EVMARKER_HAS_HDF5
#include <hdf5.h>

#include <algorithm>
#include <string>
#include <utility>

namespace evmarker::io {

/// Something that libhdf5 has opened.
class Hdf5Handle {
 public:
  using Close = herr_t (*)(hid_t);

  Hdf5Handle() = default;
  /// @param id what an opening function returned, negative where it failed
  Hdf5Handle(hid_t id, Close close) : id_(id), close_(close) {}
  Hdf5Handle(Hdf5Handle&& other) noexcept : id_(std::exchange(other.id_, -1)), close_(other.close_) {}
  Hdf5Handle& operator=(Hdf5Handle&& other) noexcept {
    std::swap(id_, other.id_);
    std::swap(close_, other.close_);
    return *this;
  }
  ~Hdf5Handle() {
    if (id_ >= 0) close_(id_);
  }

  explicit operator bool() const noexcept { return id_ >= 0; }
  hid_t get() const noexcept { return id_; }

 private:
  hid_t id_ = -1;
  Close close_ = nullptr;
};

/// Keeps libhdf5 from printing its errors while it lives.
class Hdf5Silence {
 public:
  Hdf5Silence() {
    H5Eget_auto2(H5E_DEFAULT, &print_, &data_);
    H5Eset_auto2(H5E_DEFAULT, nullptr, nullptr);
  }
  ~Hdf5Silence() { H5Eset_auto2(H5E_DEFAULT, print_, data_); }
  Hdf5Silence(const Hdf5Silence&) = delete;
  Hdf5Silence& operator=(const Hdf5Silence&) = delete;

  /// The cause of the last error, in one line.
  static std::string last_error() {
    std::string cause = "unknown error";
    const auto take_first = [](unsigned number, const H5E_error2_t* error, void* text) -> herr_t {
      if (number == 0 && error->desc != nullptr) *static_cast<std::string*>(text) = error->desc;
      return 0;
    };
    H5Ewalk2(H5E_DEFAULT, H5E_WALK_UPWARD, take_first, &cause);
    std::ranges::replace(cause, '\n', ' ');
    return cause;
  }

 private:
  H5E_auto2_t print_ = nullptr;
  void* data_ = nullptr;
};

}  // namespace evmarker::io
#endif

namespace evmarker::io {

/// What reading or writing HDF5 throws without the component `hdf5`.
inline RecordingError without_hdf5(const std::filesystem::path& path) {
  return {path,
          "HDF5 recordings need libhdf5, which this build leaves out: install libhdf5-dev and build with evmarker's "
          "component hdf5"};
}

}  // namespace evmarker::io
