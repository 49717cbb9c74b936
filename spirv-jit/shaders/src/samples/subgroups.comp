layout(local_size_x = 64) in;
layout(set = 0, binding = 0) buffer B { uvec4 f[]; } b;
void main() {
    uint id = gl_GlobalInvocationID.x;
    uvec4 x = b.f[id];
    bool c = (x.x & 1) != 0;
    if (subgroupElect()) x.y += 1;
    x.x += uint(subgroupAll(c)) + uint(subgroupAny(c)) + uint(subgroupAllEqual(x.y));
    x += subgroupBroadcast(x, 3) + subgroupBroadcastFirst(x) + subgroupBallot(c);
    x.x += uint(subgroupInverseBallot(x)) + uint(subgroupBallotBitExtract(x, 5)) + subgroupBallotBitCount(x)
         + subgroupBallotInclusiveBitCount(x) + subgroupBallotExclusiveBitCount(x) + subgroupBallotFindLSB(x) + subgroupBallotFindMSB(x);
    x += subgroupShuffle(x, id & 15) + subgroupShuffleXor(x, 3) + subgroupShuffleUp(x, 1) + subgroupShuffleDown(x, 2);
    x += subgroupAdd(x) + subgroupMul(x) + subgroupMin(x) + subgroupMax(x) + subgroupAnd(x) + subgroupOr(x) + subgroupXor(x)
       + subgroupInclusiveAdd(x) + subgroupExclusiveMax(x) + subgroupClusteredAdd(x, 4);
    x.y += uint(subgroupAnd(c)) + uint(subgroupExclusiveOr(c));
    x += subgroupQuadBroadcast(x, 2) + subgroupQuadSwapHorizontal(x) + subgroupQuadSwapVertical(x) + subgroupQuadSwapDiagonal(x);
    x += gl_SubgroupSize + gl_SubgroupInvocationID + gl_SubgroupID + gl_NumSubgroups + gl_SubgroupEqMask + gl_SubgroupGeMask
       + gl_SubgroupGtMask + gl_SubgroupLeMask + gl_SubgroupLtMask;
    subgroupBarrier(); subgroupMemoryBarrier();
    vec4 f = vec4(x); f += subgroupAdd(f) + subgroupMin(f);
    x += uvec4(f) + uvec4(clockRealtime2x32EXT(), clock2x32ARB());
    b.f[id] = x;
}
