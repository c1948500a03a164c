// Vectors of three numbers, rotations, and angles up to whole turns, for the geometry in space.
#pragma once

#include <array>
#include <cmath>
#include <numbers>

namespace cdrj {

inline constexpr double PI = std::numbers::pi;

/// a - b floor(a / b), in [0, b) for positive b, rounded as Python rounds it.
inline double modulo(double a, double b) {
    const double rest = std::fmod(a, b);
    if (rest != 0.0) return (b < 0.0) != (rest < 0.0) ? rest + b : rest;
    return std::copysign(0.0, b);
}

/// The same angle in [-pi, pi).
inline double wrap_to_pi(double angle) { return modulo(angle + PI, 2.0 * PI) - PI; }

struct Vector3 {
    double x, y, z;
};

/// A matrix by rows.
struct Matrix3 {
    std::array<double, 9> row;
};

inline constexpr Vector3 ZERO{0.0, 0.0, 0.0};
inline constexpr Vector3 Z_AXIS{0.0, 0.0, 1.0};

inline Vector3 operator+(const Vector3& a, const Vector3& b) {
    return {a.x + b.x, a.y + b.y, a.z + b.z};
}

inline Vector3 operator-(const Vector3& a, const Vector3& b) {
    return {a.x - b.x, a.y - b.y, a.z - b.z};
}

inline Vector3 operator*(double s, const Vector3& a) { return {s * a.x, s * a.y, s * a.z}; }

/// s a + t b.
inline Vector3 combined(double s, const Vector3& a, double t, const Vector3& b) {
    return {s * a.x + t * b.x, s * a.y + t * b.y, s * a.z + t * b.z};
}

inline double dot(const Vector3& a, const Vector3& b) { return a.x * b.x + a.y * b.y + a.z * b.z; }

inline Vector3 cross(const Vector3& a, const Vector3& b) {
    return {a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x};
}

inline double norm(const Vector3& a) { return std::sqrt(a.x * a.x + a.y * a.y + a.z * a.z); }

/// A vector in a plane.
struct Vector2 {
    double x, y;
};

inline Vector2 operator+(const Vector2& a, const Vector2& b) { return {a.x + b.x, a.y + b.y}; }

inline Vector2 operator-(const Vector2& a, const Vector2& b) { return {a.x - b.x, a.y - b.y}; }

inline Vector2 operator*(double s, const Vector2& a) { return {s * a.x, s * a.y}; }

/// s a + t b.
inline Vector2 combined(double s, const Vector2& a, double t, const Vector2& b) {
    return {s * a.x + t * b.x, s * a.y + t * b.y};
}

inline double dot(const Vector2& a, const Vector2& b) { return a.x * b.x + a.y * b.y; }

/// Positive where b lies to the left of a.
inline double cross(const Vector2& a, const Vector2& b) { return a.x * b.y - a.y * b.x; }

inline double norm(const Vector2& a) { return std::sqrt(a.x * a.x + a.y * a.y); }

/// `a` turned to the left by a right angle.
inline Vector2 left_of(const Vector2& a) { return {-a.y, a.x}; }

/// `a` turned to the left by an angle.
inline Vector2 turned(const Vector2& a, double angle) {
    return combined(std::cos(angle), a, std::sin(angle), left_of(a));
}

/// Part of a vector in the plane z = 0.
inline Vector2 flat(const Vector3& a) { return {a.x, a.y}; }

/// The vector of the plane z = 0 in space.
inline Vector3 in_space(const Vector2& a) { return {a.x, a.y, 0.0}; }

/// R a.
inline Vector3 rotated(const Matrix3& r, const Vector3& a) {
    const auto& m = r.row;
    return {
        m[0] * a.x + m[1] * a.y + m[2] * a.z,
        m[3] * a.x + m[4] * a.y + m[5] * a.z,
        m[6] * a.x + m[7] * a.y + m[8] * a.z,
    };
}

/// R^T a.
inline Vector3 rotated_back(const Matrix3& r, const Vector3& a) {
    const auto& m = r.row;
    return {
        m[0] * a.x + m[3] * a.y + m[6] * a.z,
        m[1] * a.x + m[4] * a.y + m[7] * a.z,
        m[2] * a.x + m[5] * a.y + m[8] * a.z,
    };
}

/// The product of two rotations.
inline Matrix3 product(const Matrix3& left, const Matrix3& right) {
    Matrix3 result{};
    for (int i = 0; i < 3; ++i) {
        for (int k = 0; k < 3; ++k) {
            result.row[3 * i + k] = left.row[3 * i] * right.row[k] +
                                    left.row[3 * i + 1] * right.row[3 + k] +
                                    left.row[3 * i + 2] * right.row[6 + k];
        }
    }
    return result;
}

/// `a` turned about a unit vector (Rodrigues).
inline Vector3 about(const Vector3& axis, double cosine, double sine, const Vector3& a) {
    const double along = (1.0 - cosine) * dot(axis, a);
    return combined(cosine, a, sine, cross(axis, a)) + along * axis;
}

/// The last row of a matrix of unit vectors: the axis of a body, in the base.
inline Vector3 axis_of(const Matrix3& basis) {
    return {basis.row[6], basis.row[7], basis.row[8]};
}

}  // namespace cdrj
