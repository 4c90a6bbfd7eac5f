#pragma once

#include <algorithm>
#include <bit>
#include <cstdint>
#include <cstring>
#include <istream>
#include <ostream>
#include <string>
#include <string_view>
#include <type_traits>
#include <vector>

#include "s3lam/base/error.h"

namespace s3lam::internal {

static_assert(std::endian::native == std::endian::little, "files are little endian");

/// Buffered reading of little-endian values. Knows how much of the stream is left, so that counts
/// can be held against it before anything is allocated. Needs a stream that can seek.
class BinaryReader {
 public:
  BinaryReader(std::istream& stream, const std::string& source) : stream_(stream), source_(source) {
    const std::istream::pos_type start = stream.tellg();
    stream.seekg(0, std::ios::end);
    const std::istream::pos_type end = stream.tellg();
    stream.seekg(start);
    if (!stream || start < 0 || end < start) ThrowInputError("{}: cannot read", source);
    remaining_ = static_cast<uint64_t>(end - start);
    buffer_.resize(static_cast<size_t>(std::min<uint64_t>(kBufferSize, remaining_)));
  }

  /// Bytes not yet handed out.
  [[nodiscard]] uint64_t remaining() const { return remaining_; }

  template <typename T>
  requires std::is_trivially_copyable_v<T> T Value() {
    T value;
    Bytes(&value, sizeof(T));
    return value;
  }

  void Bytes(void* target, size_t size) {
    if (size > remaining_) FailCut();
    remaining_ -= size;
    char* out = static_cast<char*>(target);
    while (size > 0) {
      if (position_ == filled_) Fill();
      const size_t chunk = std::min(size, filled_ - position_);
      std::memcpy(out, buffer_.data() + position_, chunk);
      position_ += chunk;
      out += chunk;
      size -= chunk;
    }
  }

  /// A uint64 count of items of at least `min_item_size` bytes each. Throws if they cannot fit.
  uint64_t Count(size_t min_item_size, const char* what) {
    const uint64_t count = Value<uint64_t>();
    if (count > remaining_ / min_item_size) {
      ThrowInputError("{}: claims {} {} where {} bytes are left: cut short or damaged", source_,
                      count, what, remaining_);
    }
    return count;
  }

  /// Characters up to a zero byte.
  std::string ZeroTerminated(size_t max_size, const char* what) {
    std::string text;
    for (char c = Value<char>(); c != '\0'; c = Value<char>()) {
      text.push_back(c);
      if (text.size() > max_size) {
        ThrowInputError("{}: {} longer than {} bytes: damaged", source_, what, max_size);
      }
    }
    return text;
  }

  void ExpectEnd() const {
    if (remaining_ > 0) {
      ThrowInputError("{}: {} bytes after the last entry: damaged", source_, remaining_);
    }
  }

 private:
  static constexpr size_t kBufferSize = 1 << 20;

  [[noreturn]] void FailCut() const { ThrowInputError("{}: ends too early: cut short", source_); }

  void Fill() {
    stream_.read(buffer_.data(), static_cast<std::streamsize>(buffer_.size()));
    filled_ = static_cast<size_t>(stream_.gcount());
    position_ = 0;
    if (filled_ == 0) FailCut();
  }

  std::istream& stream_;
  const std::string& source_;
  std::vector<char> buffer_;
  size_t position_ = 0;
  size_t filled_ = 0;
  uint64_t remaining_ = 0;
};

/// Buffered writing of little-endian values; flushes to the stream when it is destroyed or full.
class BinaryWriter {
 public:
  explicit BinaryWriter(std::ostream& stream) : stream_(stream) { buffer_.reserve(kBufferSize); }
  ~BinaryWriter() { Flush(); }
  BinaryWriter(const BinaryWriter&) = delete;
  BinaryWriter& operator=(const BinaryWriter&) = delete;

  template <typename T>
  requires std::is_trivially_copyable_v<T>
  void Value(const T& value) { Bytes(&value, sizeof(T)); }

  void Bytes(const void* data, size_t size) {
    if (buffer_.size() + size > kBufferSize) Flush();
    const char* begin = static_cast<const char*>(data);
    buffer_.insert(buffer_.end(), begin, begin + size);
  }

 private:
  static constexpr size_t kBufferSize = 1 << 20;

  void Flush() {
    stream_.write(buffer_.data(), static_cast<std::streamsize>(buffer_.size()));
    buffer_.clear();
  }

  std::ostream& stream_;
  std::vector<char> buffer_;
};

/// Reads what WriteHeader wrote; throws InputError for another kind of file and another version.
inline void ExpectHeader(BinaryReader& reader, std::string_view magic, std::string_view version,
                         const char* what, const std::string& source) {
  std::string header(magic.size() + version.size(), '\0');
  if (reader.remaining() >= header.size()) reader.Bytes(header.data(), header.size());
  if (!header.starts_with(magic)) ThrowInputError("{}: not a file of {}", source, what);
  if (!header.ends_with(version)) {
    ThrowInputError("{}: version {} is not known here (only {}); write it anew with s3-slam",
                    source, header.substr(magic.size()), version);
  }
}

/// A file begins with its kind and the version of its format.
inline void WriteHeader(BinaryWriter& writer, std::string_view magic, std::string_view version) {
  writer.Bytes(magic.data(), magic.size());
  writer.Bytes(version.data(), version.size());
}

}  // namespace s3lam::internal
