// Records in at most 16 cells how a value changes over time, however long the time is. A cell has the mean of
// consecutive values.
#pragma once

#include <cmath>
#include <cstdint>

namespace fltea {

struct TimeCell {
    std::uint64_t first;  // number of the first sample of the cell
    std::uint32_t count;
    float mean, squares;  // mean of the values, and sum of their squared deviations from the mean
};

class TimeCells {
  public:
    enum { kMost = 16 };

    // `span`: fixed number of values in a cell. When all cells are full, the oldest cell is dropped. If
    // `span` is 0, neighbouring cells are joined instead, so that cells become wider.
    explicit TimeCells(std::uint32_t span = 0) : each_(span > 0 ? span : 1), forgets_(span > 0), size_(0) {}

    int size() const { return size_; }
    std::uint32_t each() const { return each_; }
    TimeCell operator[](int i) const {
        const TimeCell cell = {first_[i], count_[i], mean_[i], squares_[i]};
        return cell;
    }

    void add(std::uint64_t first, float figure) {
        const TimeCell one = {first, 1, figure, 0};
        add(one);
    }

    // Adds `cell`, which must be later than all other cells.
    void add(const TimeCell& cell) {
        if (size_ > 0 && count_[size_ - 1] + cell.count <= each_) {
            put(size_ - 1, joined((*this)[size_ - 1], cell));
            return;
        }
        if (size_ == kMost) {
            if (forgets_) {
                drop_oldest();
            } else {
                join_neighbours();
            }
        }
        put(size_++, cell);
    }

    // Appends the cells of a later part of the record. Sample 0 of that part is sample `shift` of this
    // record.
    void merge(const TimeCells& other, std::uint64_t shift) {
        while (!forgets_ && each_ < other.each_ && each_ < kWidest) join_neighbours();
        for (int i = 0; i < other.size_; ++i) {
            TimeCell cell = other[i];
            cell.first += shift;
            add(cell);
        }
    }

    // Saves or loads each number by calling io.number(value, low, high) or io.real(value, low, high). If
    // io.sound() is true afterwards, the numbers are valid.
    template <typename Io>
    void visit(Io& io) {
        io.number(size_, 0, kMost);
        io.number(each_, forgets_ ? each_ : 1, forgets_ ? each_ : kWidest);
        for (int i = 0; i < size_ && io.sound(); ++i) {
            io.number(first_[i], 0, 1e15);
            io.number(count_[i], 1, kWidest);
            io.real(mean_[i], -2e3, 2e3);
            io.real(squares_[i], 0, 1e16);
        }
    }

  private:
    static constexpr std::uint32_t kWidest = 1u << 30;

    static TimeCell joined(const TimeCell& a, const TimeCell& b) {
        const double n = double(a.count) + double(b.count), apart = double(b.mean) - double(a.mean);
        const double share = double(b.count) / n;
        const TimeCell result = {
            a.first, a.count + b.count, float(double(a.mean) + apart * share),
            float(double(a.squares) + double(b.squares) + apart * apart * share * double(a.count))};
        return result;
    }

    void put(int i, const TimeCell& cell) {
        first_[i] = cell.first;
        count_[i] = cell.count;
        mean_[i] = cell.mean;
        squares_[i] = cell.squares;
    }

    void drop_oldest() {
        for (int i = 1; i < size_; ++i) put(i - 1, (*this)[i]);
        --size_;
    }

    void join_neighbours() {
        int to = 0;
        for (int i = 0; i < size_; i += 2, ++to) {
            put(to, i + 1 < size_ ? joined((*this)[i], (*this)[i + 1]) : (*this)[i]);
        }
        size_ = to;
        each_ *= 2;
    }

    // The cells are stored as columns, because an array of structs would be a sixth larger.
    std::uint64_t first_[kMost];
    std::uint32_t count_[kMost];
    float mean_[kMost], squares_[kMost];
    std::uint32_t each_;
    bool forgets_;
    int size_;
};

}  // namespace fltea
