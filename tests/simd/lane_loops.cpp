// All loops over lanes, for the test that the compiler vectorises them.
#include "evmarker/tracking/edge_follower.hpp"
#include "evmarker/update/decoupled_update.hpp"
#include "evmarker/update/kalman_update.hpp"

template class evmarker::EdgeFollower<evmarker::KalmanUpdate>;
template class evmarker::EdgeFollower<evmarker::DecoupledUpdate>;
