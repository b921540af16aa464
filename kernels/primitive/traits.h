/* What a primitive is, in bits of one number: many are kept. */
#ifndef TFM_PRIMITIVE_TRAITS_H
#define TFM_PRIMITIVE_TRAITS_H

#define SHAPE_TRAITS(is_thin, profile) ((profile) << 1 | (is_thin))
#define BODY_TRAITS(kind, medium) ((medium) << 8 | (kind) << 4)

/* 1: rays cross it in one place. */
#define PRIMITIVE_IS_THIN(primitive) ((primitive)->traits & 1)
/* As its kind has it. */
#define PRIMITIVE_PROFILE(primitive) ((primitive)->traits >> 1 & 7)
#define PRIMITIVE_KIND(primitive) ((primitive)->traits >> 4 & 15)
#define PRIMITIVE_MEDIUM(primitive) ((primitive)->traits >> 8)

#endif
