// What looks like something that the Cortex-M3 refuses, and is allowed: one word or halfword anywhere, a
// byte that is exclusive, several words at a multiple of 4 that is none of 8, division by 0 without its trap,
// YIELD, a jump by MOV without bit 0.
// slots: 0 0x33221144, 1 0x3322, 2 0x11, 3 0x44, 4 0, 5 0x55
  ldr r5, =0x20080000
  ldr r1, =0x22114477
  str r1, [r5]
  ldr r1, =0x66554433
  str r1, [r5, #4]
  ldr r1, [r5, #1]
  keep r1, 0
  ldrh r1, [r5, #3]
  keep r1, 1
  adds r3, r5, #2
  ldrexb r1, [r3]
  keep r1, 2
  adds r3, r5, #1
  ldrb r1, [r3]
  keep r1, 3
  adds r3, r5, #4
  strd r1, r2, [r3]
  ldmia r3, {r1, r2}
  ldmia.w r3!, {r6, r7}
  ldrex r6, [r5, #4]
  clrex
  movs r1, #0
  udiv r4, r3, r1
  keep r4, 4
  yield
  adr r1, 1f
  mov pc, r1
  udf #0
.align 2
1: movs r1, #0x55
  keep r1, 5
  wait_forever
