#include <libdeflate.h>

#include <algorithm>
#include <limits>
#include <string_view>

#include "inflate.h"
#include "npy_array.h"
#include "s3lam/base/error.h"

namespace s3lam {
namespace {

// A ZIP archive ends with a record that says where its directory is (PKWARE APPNOTE 4.3).
constexpr std::string_view kEndSignature("PK\x05\x06", 4);
constexpr std::string_view kEntrySignature("PK\x01\x02", 4);
constexpr std::string_view kLocalSignature("PK\x03\x04", 4);
constexpr size_t kEndSize = 22;
constexpr size_t kEntrySize = 46;
constexpr size_t kLocalSize = 30;
constexpr uint32_t kIsZip64 = std::numeric_limits<uint32_t>::max();

struct Entry {
  std::string name;
  uint32_t method = 0;  // 0 stored, 8 deflated.
  uint32_t checksum = 0;
  uint32_t packed_size = 0;
  uint32_t size = 0;
  uint32_t local_offset = 0;
};

class Archive {
 public:
  Archive(const std::string& bytes, const std::string& source) : bytes_(bytes), source_(source) {}

  [[nodiscard]] std::vector<Entry> ReadDirectory() const {
    // The end record may be followed by a comment of up to 64 KiB.
    const size_t end = bytes_.rfind(kEndSignature);
    if (!bytes_.starts_with("PK") || end == std::string::npos || bytes_.size() - end < kEndSize) {
      ThrowInputError("{}: not a .npz archive, or cut short", source_);
    }
    const size_t count = Number(end + 10, 2);
    size_t at = Number(end + 16, 4);
    std::vector<Entry> entries;
    for (size_t i = 0; i < count; ++i) {
      Require(at, kEntrySize, kEntrySignature);
      const size_t name_size = Number(at + 28, 2);
      Require(at, kEntrySize + name_size, kEntrySignature);
      entries.push_back({bytes_.substr(at + kEntrySize, name_size), Number(at + 10, 2),
                         Number(at + 16, 4), Number(at + 20, 4), Number(at + 24, 4),
                         Number(at + 42, 4)});
      at += kEntrySize + name_size + Number(at + 30, 2) + Number(at + 32, 2);
    }
    return entries;
  }

  [[nodiscard]] std::string Extract(const Entry& entry) const {
    if (entry.size == kIsZip64 || entry.packed_size == kIsZip64 || entry.local_offset == kIsZip64) {
      ThrowInputError("{}: {} has 4 GiB or more", source_, entry.name);
    }
    const size_t at = entry.local_offset;
    Require(at, kLocalSize, kLocalSignature);
    const size_t begin = at + kLocalSize + Number(at + 26, 2) + Number(at + 28, 2);
    Require(at, begin - at + entry.packed_size, kLocalSignature);
    const std::string_view packed = std::string_view(bytes_).substr(begin, entry.packed_size);
    std::string content;
    if (entry.method == 0) {
      content = packed;
    } else if (entry.method == 8) {
      content = Inflate(packed, entry.size, Wrapping::kNone).value_or("");
    } else {
      ThrowInputError("{}: {} is compressed by method {} (wanted deflate)", source_, entry.name,
                      entry.method);
    }
    const uint32_t checksum = libdeflate_crc32(0, content.data(), content.size());
    if (content.size() != entry.size || checksum != entry.checksum) {
      ThrowInputError("{}: {} is damaged", source_, entry.name);
    }
    return content;
  }

 private:
  /// Little-endian number at a place that is known to exist.
  [[nodiscard]] uint32_t Number(size_t at, size_t size) const {
    uint32_t value = 0;
    for (size_t i = 0; i < size; ++i) {
      value |= static_cast<uint32_t>(static_cast<uint8_t>(bytes_[at + i])) << (8 * i);
    }
    return value;
  }

  void Require(size_t at, size_t size, std::string_view signature) const {
    const bool fits = at <= bytes_.size() && size <= bytes_.size() - at;
    if (!fits || bytes_.compare(at, signature.size(), signature) != 0) {
      ThrowInputError("{}: .npz archive is cut short or damaged", source_);
    }
  }

  const std::string& bytes_;
  const std::string& source_;
};

}  // namespace

std::string ExtractNpz(const std::string& archive, const std::string& source) {
  const Archive reader(archive, source);
  std::vector<Entry> arrays = reader.ReadDirectory();
  std::erase_if(arrays, [](const Entry& e) { return !e.name.ends_with(".npy"); });
  if (arrays.empty()) ThrowInputError("{}: no array in it", source);
  if (arrays.size() == 1) return reader.Extract(arrays.front());
  for (const std::string_view wanted : {"probabilities.npy", "arr_0.npy"}) {
    for (const Entry& entry : arrays) {
      if (entry.name == wanted) return reader.Extract(entry);
    }
  }
  ThrowInputError("{}: {} arrays, none named 'probabilities' or 'arr_0'", source, arrays.size());
}

}  // namespace s3lam
