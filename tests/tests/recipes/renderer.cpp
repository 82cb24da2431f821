// A small renderer in C++ that only writes PNG: renderer IMAGE.png [FACTOR]. It stands for the one
// of a reader of docs/ci.md. FACTOR changes the brightness, as a fault would.

#include <cmath>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <vector>

using Bytes = std::vector<uint8_t>;

static void append32(Bytes &to, uint32_t value) {
    for (int shift = 24; shift >= 0; shift -= 8) to.push_back(uint8_t(value >> shift));
}

static void append_chunk(Bytes &file, const char *kind, const Bytes &data) {
    append32(file, uint32_t(data.size()));
    const size_t start = file.size();
    file.insert(file.end(), kind, kind + 4);
    file.insert(file.end(), data.begin(), data.end());
    uint32_t crc = 0xffffffff;
    for (size_t i = start; i < file.size(); i++) {
        crc ^= file[i];
        for (int bit = 0; bit < 8; bit++) crc = crc & 1 ? (crc >> 1) ^ 0xedb88320 : crc >> 1;
    }
    append32(file, ~crc);
}

// A PNG file whose data is stored, not compressed.
static Bytes png(const Bytes &rgb, uint32_t width, uint32_t height) {
    Bytes rows;
    for (uint32_t y = 0; y < height; y++) {
        rows.push_back(0);
        rows.insert(rows.end(), rgb.begin() + 3 * width * y, rgb.begin() + 3 * width * (y + 1));
    }
    const uint16_t length = uint16_t(rows.size()), inverse = uint16_t(~length);
    Bytes stored = {0x78, 0x01, 1, uint8_t(length), uint8_t(length >> 8), uint8_t(inverse), uint8_t(inverse >> 8)};
    stored.insert(stored.end(), rows.begin(), rows.end());
    uint32_t a = 1, b = 0;
    for (uint8_t byte : rows) {
        a = (a + byte) % 65521;
        b = (b + a) % 65521;
    }
    append32(stored, b << 16 | a);
    Bytes header;
    append32(header, width);
    append32(header, height);
    header.insert(header.end(), {8, 2, 0, 0, 0});
    Bytes file = {0x89, 'P', 'N', 'G', '\r', '\n', 0x1a, '\n'};
    append_chunk(file, "IHDR", header);
    append_chunk(file, "IDAT", stored);
    append_chunk(file, "IEND", {});
    return file;
}

int main(int count, char **arguments) {
    if (count < 2) return 2;
    const double factor = count > 2 ? std::atof(arguments[2]) : 1.0;
    const int width = 48, height = 32;
    Bytes rgb;
    for (int y = 0; y < height; y++) {
        for (int x = 0; x < width; x++) {
            const double u = (x + 0.5 - width / 2.0) / 12.0, v = (height / 2.0 - y - 0.5) / 12.0;
            const double inside = 1.0 - u * u - v * v;
            const double cosine = (u + v + std::sqrt(std::fmax(inside, 0.0))) / std::sqrt(3.0);
            const double value = inside > 0.0 ? factor * std::fmax(cosine, 0.0) : 0.1;
            for (int channel = 0; channel < 3; channel++) {
                const double encoded = std::pow(std::fmin(value, 1.0), 1.0 / 2.2);
                rgb.push_back(uint8_t(255.0 * encoded + 0.5));
            }
        }
    }
    const Bytes file = png(rgb, width, height);
    std::FILE *out = std::fopen(arguments[1], "wb");
    if (!out) return 1;
    const bool written = std::fwrite(file.data(), 1, file.size(), out) == file.size();
    return std::fclose(out) == 0 && written ? 0 : 1;
}
