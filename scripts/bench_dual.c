/* The dual march once more, in plain C for the CPU: what scripts/bench.py compares the OpenCL kernels with.
   A dense grid, one ray at a time; steps of equal length; no light ray from a view sample without density; a ray
   ends at the cutoff. Knows one spot light with a hard edge, a grey medium and isotropic scattering.

     bench_dual INPUT OUTPUT THREADS

   INPUT: Scene, then the padded grid, float [z][y][x].
   OUTPUT: float RGB [height][width]. Prints the seconds that the march took. */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <time.h>

/* All members are 4 bytes wide: bench.py writes floats, then ints. The world's origin is the grid's centre. */
typedef struct {
  float index_from_world[12]; /* 3x4 row major, to the padded grid */
  float light_from_world[12]; /* the light looks along +z */
  float light_position[3];
  float tangent; /* of the cone's half angle */
  float camera_position[3];
  float camera_right[3]; /* times tan(fov/2) * width / height */
  float camera_up[3];    /* times tan(fov/2) */
  float camera_forward[3];
  float sigma_t; /* of a voxel of 1 */
  float cutoff;
  float colour[3]; /* albedo times intensity over 4 pi */
  int grid_size[3];
  int image_size[2];
  int view_steps;
  int light_steps;
  int inverse_square; /* 1: falloff with the square of the distance */
} Scene;

typedef struct {
  float x, y, z;
} Vec3;

typedef struct {
  Vec3 origin, direction;
} Ray;

typedef struct {
  float begin, end;
} Interval;

static Vec3 at(Ray ray, float t)
{
  return (Vec3){ray.origin.x + t * ray.direction.x, ray.origin.y + t * ray.direction.y,
                ray.origin.z + t * ray.direction.z};
}

static float dot(Vec3 a, Vec3 b)
{
  return a.x * b.x + a.y * b.y + a.z * b.z;
}

static Vec3 turned(const float *m, Vec3 v)
{
  return (Vec3){m[0] * v.x + m[1] * v.y + m[2] * v.z, m[4] * v.x + m[5] * v.y + m[6] * v.z,
                m[8] * v.x + m[9] * v.y + m[10] * v.z};
}

static Vec3 moved(const float *m, Vec3 p)
{
  const Vec3 v = turned(m, p);
  return (Vec3){v.x + m[3], v.y + m[7], v.z + m[11]};
}

static Ray ray_in(const float *m, Ray ray)
{
  return (Ray){moved(m, ray.origin), turned(m, ray.direction)};
}

/* fminf and fmaxf ignore the NaN of a ray within a side of the box. */
static void clip_axis(float origin, float direction, int count, Interval *k)
{
  const float near = -origin / direction, far = ((float)(count - 1) - origin) / direction;
  k->begin = fmaxf(k->begin, fminf(near, far));
  k->end = fminf(k->end, fmaxf(near, far));
}

static int clip_medium(const Scene *p, Ray ray, Interval *k)
{
  clip_axis(ray.origin.x, ray.direction.x, p->grid_size[0], k);
  clip_axis(ray.origin.y, ray.direction.y, p->grid_size[1], k);
  clip_axis(ray.origin.z, ray.direction.z, p->grid_size[2], k);
  return k->begin < k->end;
}

/* The solid cone x^2 + y^2 <= k^2 z^2, z >= 0, in light space: a t^2 + 2 b t + c <= 0 on the nappe in front. */
static int clip_cone(const Scene *p, Ray world, Interval *k)
{
  const Ray ray = ray_in(p->light_from_world, world);
  const float shift = -dot(ray.origin, ray.direction); /* measured from the point nearest to the apex */
  const Vec3 o = at(ray, shift), d = ray.direction;
  const float k2 = p->tangent * p->tangent;
  const float a = d.x * d.x + d.y * d.y - k2 * d.z * d.z;
  const float b = o.x * d.x + o.y * d.y - k2 * o.z * d.z;
  const float c = o.x * o.x + o.y * o.y - k2 * o.z * o.z;
  const float discriminant = b * b - a * c;
  if (a > 0.0f && discriminant <= 0.0f)
    return 0;
  const float q = -(b + copysignf(sqrtf(fmaxf(discriminant, 0.0f)), b));
  const float first = fminf(c / q, q / a), last = fmaxf(c / q, q / a);
  if (a > 0.0f) {
    if (o.z + 0.5f * (first + last) * d.z < 0.0f)
      return 0;
    k->begin = fmaxf(k->begin, first + shift);
    k->end = fminf(k->end, last + shift);
  } else if (d.z > 0.0f) {
    k->begin = fmaxf(k->begin, last + shift);
  } else {
    k->end = fminf(k->end, first + shift);
  }
  return k->begin < k->end;
}

static float lerp(float a, float b, float t)
{
  return a + t * (b - a);
}

static int cell_of(float x, int count)
{
  const int cell = (int)x;
  return cell < 0 ? 0 : cell > count - 2 ? count - 2 : cell;
}

/* Voxel value, not yet scaled. */
static float density(const Scene *p, const float *grid, Vec3 point)
{
  const int row = p->grid_size[0], layer = row * p->grid_size[1];
  const int x = cell_of(point.x, p->grid_size[0]);
  const int y = cell_of(point.y, p->grid_size[1]);
  const int z = cell_of(point.z, p->grid_size[2]);
  const float fx = point.x - (float)x, fy = point.y - (float)y, fz = point.z - (float)z;
  const float *v = grid + ((size_t)z * (size_t)layer + (size_t)y * (size_t)row + (size_t)x);
  const float near = lerp(lerp(v[0], v[1], fx), lerp(v[row], v[row + 1], fx), fy);
  v += layer;
  const float far = lerp(lerp(v[0], v[1], fx), lerp(v[row], v[row + 1], fx), fy);
  return lerp(near, far, fz);
}

static float optical_depth(const Scene *p, const float *grid, Ray ray, Interval k, int steps)
{
  const float length = (k.end - k.begin) / (float)steps;
  float sum = 0.0f;
  for (int n = 0; n < steps; ++n)
    sum += density(p, grid, at(ray, k.begin + ((float)n + 0.5f) * length));
  return sum * length;
}

/* Light that arrives at a world point through the medium, for an intensity of 1. */
static float light_at(const Scene *p, const float *grid, Vec3 point)
{
  const Vec3 apex = {p->light_position[0], p->light_position[1], p->light_position[2]};
  const Vec3 way = {point.x - apex.x, point.y - apex.y, point.z - apex.z};
  const float distance = sqrtf(dot(way, way));
  const Vec3 unit = {way.x / distance, way.y / distance, way.z / distance};
  const Ray ray = ray_in(p->index_from_world, (Ray){apex, unit});
  Interval k = {0.0f, distance};
  const float depth = clip_medium(p, ray, &k) ? optical_depth(p, grid, ray, k, p->light_steps) : 0.0f;
  return expf(-p->sigma_t * depth) * (p->inverse_square ? 1.0f / dot(way, way) : 1.0f);
}

/* Single scattering along the camera ray of a pixel, for a colour of 1. */
static float radiance(const Scene *p, const float *grid, int px, int py)
{
  const float x = 2.0f * ((float)px + 0.5f) / (float)p->image_size[0] - 1.0f;
  const float y = 1.0f - 2.0f * ((float)py + 0.5f) / (float)p->image_size[1];
  const float *r = p->camera_right, *u = p->camera_up, *f = p->camera_forward;
  const Vec3 d = {f[0] + x * r[0] + y * u[0], f[1] + x * r[1] + y * u[1], f[2] + x * r[2] + y * u[2]};
  const float scale = 1.0f / sqrtf(dot(d, d));
  const Ray ray = {{p->camera_position[0], p->camera_position[1], p->camera_position[2]},
                   {d.x * scale, d.y * scale, d.z * scale}};
  const Ray in_grid = ray_in(p->index_from_world, ray);
  Interval medium = {0.0f, INFINITY};
  if (!clip_medium(p, in_grid, &medium))
    return 0.0f;
  Interval lit = medium;
  if (!clip_cone(p, ray, &lit))
    return 0.0f;
  const Interval before = {medium.begin, lit.begin};
  const float share = (before.end - before.begin) / (medium.end - medium.begin);
  const int unlit_steps = (int)ceilf((float)p->view_steps * share);
  float through = 1.0f, sum = 0.0f;
  if (unlit_steps > 0)
    through = expf(-p->sigma_t * optical_depth(p, grid, in_grid, before, unlit_steps));
  const float length = (lit.end - lit.begin) / (float)p->view_steps;
  for (int n = 0; n < p->view_steps && through > p->cutoff; ++n) {
    const float t = lit.begin + ((float)n + 0.5f) * length;
    const float step_depth = p->sigma_t * length * density(p, grid, at(in_grid, t));
    if (step_depth <= 0.0f)
      continue;
    const float left = through * expf(-step_depth);
    sum += (through - left) * light_at(p, grid, at(ray, t));
    through = left;
  }
  return sum;
}

static double now(void)
{
  struct timespec time;
  clock_gettime(CLOCK_MONOTONIC, &time);
  return (double)time.tv_sec + 1e-9 * (double)time.tv_nsec;
}

static void fail(const char *what, const char *name)
{
  fprintf(stderr, "bench_dual: %s %s\n", what, name);
  exit(1);
}

int main(int count, char **arguments)
{
  if (count != 4 || atoi(arguments[3]) < 1)
    fail("use:", "bench_dual INPUT OUTPUT THREADS");
  const int threads = atoi(arguments[3]);
  FILE *file = fopen(arguments[1], "rb");
  Scene p;
  if (!file || fread(&p, sizeof p, 1, file) != 1)
    fail("no scene in", arguments[1]);
  const size_t voxels = (size_t)p.grid_size[0] * (size_t)p.grid_size[1] * (size_t)p.grid_size[2];
  const int width = p.image_size[0], height = p.image_size[1];
  const size_t values = 3 * (size_t)width * (size_t)height;
  float *grid = malloc(voxels * sizeof *grid), *image = malloc(values * sizeof *image);
  if (!grid || !image || fread(grid, sizeof *grid, voxels, file) != voxels)
    fail("no grid in", arguments[1]);
  fclose(file);

  const double began = now();
#pragma omp parallel for schedule(dynamic) num_threads(threads)
  for (int y = 0; y < height; ++y)
    for (int x = 0; x < width; ++x) {
      const float value = radiance(&p, grid, x, y);
      for (int c = 0; c < 3; ++c)
        image[3 * ((size_t)y * (size_t)width + (size_t)x) + (size_t)c] = p.colour[c] * value;
    }
  printf("%.6f\n", now() - began);

  file = fopen(arguments[2], "wb");
  if (!file || fwrite(image, sizeof *image, values, file) != values || fclose(file))
    fail("cannot write", arguments[2]);
  return 0;
}
