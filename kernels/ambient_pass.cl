/* Scattered ambient (TFM eq. 7): L_a (sigma_s / sigma_t) (1 - T) along the whole camera ray. The medium's albedo is the
   same everywhere, so that the integral of L_a sigma_s T along a march is this too. A solid reflects its albedo's part
   of L_a, dimmed by the medium. Runs once, after the view pass. One work-item a pixel.
   Requires: Params; TFM_SHADOW, 0 without solids. */

/* transmittance  of the camera rays, RGB
   albedo         of the solids that the pixels show, 0 without (with TFM_SHADOW only)
   radiance       adds the light, RGB */
__kernel void ambient_pass(PARAMS params, __global const float4 *transmittance, __global const float4 *albedo,
                           __global float4 *radiance, float4 ambient, int count)
{
  const size_t i = get_global_id(0);
  if (i >= (size_t)count)
    return;
  const float4 through = (float4)(transmittance[i].xyz, 0.0f);
  const float4 scatters = (float4)(params->albedo[0], params->albedo[1], params->albedo[2], 0.0f);
  float4 reflects = scatters * (1.0f - through);
#if TFM_SHADOW
  reflects += through * albedo[i];
#else
  (void)albedo;
#endif
  radiance[i] += ambient * reflects;
}
