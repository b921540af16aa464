// Transmittance function maps of `tfm bake`. Fill a TfmMap from an entry of maps.json, where matrices are rows, and
// sample the three textures with bilinear filtering, clamped to the edge, without mip levels.
struct TfmMap {
  mat4 light_from_world, unit_from_light;
  vec4 chart, cone, series; // scale and offset of u, v; axis and cosine; offset, scale, weighting, largest
  float reach;
  int projection; // 0 orthographic, 1 perspective, 2 hemisphere, 3 octahedron
  bool box;       // ranges are where rays cross a box, and not in the texture
};

// Optical depth, at density 1, between the light and a world point; T = exp(-extinction * it). Dark: 1e30.
float tfm_optical_depth(TfmMap map, sampler2DArray coefficients, sampler2DArray ranges, sampler2DArray functions,
                        vec3 world) {
  vec3 p = (map.light_from_world * vec4(world, 1.0)).xyz, low, high;
  float way = map.projection == 0 ? p.z : length(p);
  if (dot(map.cone.xyz, p) < map.cone.w * length(p) || way >= map.reach) return 1e30;
  vec3 n = p / (abs(p.x) + abs(p.y) + abs(p.z));
  vec2 place = map.projection == 1 ? p.xy / p.z : map.projection == 2 ? vec2(n.x + n.y, n.x - n.y) : n.xy;
  vec2 signs = vec2(n.x < 0.0 ? -1.0 : 1.0, n.y < 0.0 ? -1.0 : 1.0);
  if (map.projection == 3 && n.z < 0.0) place = (1.0 - abs(n.yx)) * signs;
  vec2 uv = map.chart.xy * (map.projection == 0 ? p.xy : place) + map.chart.zw;
  bool behind = p.z <= 0.0 && (map.projection == 1 || map.projection == 2);
  vec4 range = texture(ranges, vec3(uv, 0.0)); // begin, end, slope, last
  if (map.box) {
    vec3 a = (map.unit_from_light * vec4(map.projection == 0 ? vec3(p.xy, 0.0) : vec3(0.0), 1.0)).xyz;
    vec3 d = (map.unit_from_light * vec4(p, 1.0)).xyz - a;
    low = min(-a / d, (1.0 - a) / d), high = max(-a / d, (1.0 - a) / d);
    range = way * vec4(max(max(low.x, low.y), max(low.z, 0.0)), min(high.x, min(high.y, high.z)), 0.0, 0.0);
  }
  if (behind || any(greaterThan(abs(uv - 0.5), vec2(0.501))) || range.x >= (map.box ? range.y : way)) return 0.0;
  float v = clamp((way - range.x) / (range.y - range.x), 0.0, 1.0), sum = 0.0;
  ivec3 size = textureSize(functions, 0);
  float at = (v * float(size.x - 1) + 0.5) / float(size.x);
  for (int i = 0; i < size.z; ++i)
    sum += dot(texture(coefficients, vec3(uv, i)), texture(functions, vec3(at, 0.5, i)));
  float f = map.series.x + map.series.y * sum, weighting = map.series.z;
  float depth = weighting > 0.0 ? -weighting * log(clamp(f, 1e-37, 1.0)) : clamp(f, 0.0, map.series.w);
  return depth + (map.box ? 0.0 : max(min(way, range.w) - range.y, 0.0) * range.z);
}
