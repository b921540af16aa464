// Transmittance function maps of `tfm bake`. Fill a TfmMap from an entry of maps.json, where matrices are rows, and
// sample the three textures with bilinear filtering, clamped to the edge, without mip levels.
struct TfmMap {
  row_major float4x4 light_from_world, unit_from_light;
  float4 chart, cone, series; // scale and offset of u, v; axis and cosine; offset, scale, weighting, largest
  float reach;
  int projection; // 0 orthographic, 1 perspective, 2 hemisphere, 3 octahedron
  int box;        // 1: ranges are where rays cross a box, and not in the texture
};

// Optical depth, at density 1, between the light and a world point; T = exp(-extinction * it). Dark: 1e30.
float tfm_optical_depth(TfmMap map, Texture2DArray<float4> coefficients, Texture2DArray<float4> ranges,
                        Texture2DArray<float4> functions, SamplerState bilinear, float3 world) {
  float3 p = mul(map.light_from_world, float4(world, 1.0)).xyz, low, high, size;
  float way = map.projection == 0 ? p.z : length(p);
  if (dot(map.cone.xyz, p) < map.cone.w * length(p) || way >= map.reach) return 1e30;
  float3 n = p / (abs(p.x) + abs(p.y) + abs(p.z));
  float2 place = map.projection == 1 ? p.xy / p.z : map.projection == 2 ? float2(n.x + n.y, n.x - n.y) : n.xy;
  float2 signs = float2(n.x < 0.0 ? -1.0 : 1.0, n.y < 0.0 ? -1.0 : 1.0);
  if (map.projection == 3 && n.z < 0.0) place = (1.0 - abs(n.yx)) * signs;
  float2 uv = map.chart.xy * (map.projection == 0 ? p.xy : place) + map.chart.zw;
  bool behind = p.z <= 0.0 && (map.projection == 1 || map.projection == 2);
  float4 range = ranges.SampleLevel(bilinear, float3(uv, 0.0), 0.0); // begin, end, slope, last
  if (map.box != 0) {
    float3 a = mul(map.unit_from_light, float4(map.projection == 0 ? float3(p.xy, 0.0) : (float3)0.0, 1.0)).xyz;
    float3 d = mul(map.unit_from_light, float4(p, 1.0)).xyz - a;
    low = min(-a / d, (1.0 - a) / d), high = max(-a / d, (1.0 - a) / d);
    range = way * float4(max(max(low.x, low.y), max(low.z, 0.0)), min(high.x, min(high.y, high.z)), 0.0, 0.0);
  }
  if (behind || any(abs(uv - 0.5) > 0.501) || range.x >= (map.box != 0 ? range.y : way)) return 0.0;
  float v = clamp((way - range.x) / (range.y - range.x), 0.0, 1.0), sum = 0.0;
  functions.GetDimensions(size.x, size.y, size.z);
  float at = (v * (size.x - 1.0) + 0.5) / size.x;
  for (int i = 0; i < (int)size.z; ++i)
    sum += dot(coefficients.SampleLevel(bilinear, float3(uv, i), 0.0),
               functions.SampleLevel(bilinear, float3(at, 0.5, i), 0.0));
  float f = map.series.x + map.series.y * sum, weighting = map.series.z;
  float depth = weighting > 0.0 ? -weighting * log(clamp(f, 1e-37, 1.0)) : clamp(f, 0.0, map.series.w);
  return depth + (map.box != 0 ? 0.0 : max(min(way, range.w) - range.y, 0.0) * range.z);
}
