# Errors and backtracking signal over time: gnuplot -c demo.gnuplot errors.csv error.png
set terminal pngcairo size 1200,900 font "sans,12" background "#ffffff"
set output ARG2
set datafile separator ","
set datafile missing "nan"
set key top right opaque noautotitle
set grid back lc rgb "#dddddd"
set tics nomirror
set border 3
set lmargin 11
set multiplot layout 4,1
set xlabel ""
tracking(value) = strcol(3) eq "tracking" ? value : NaN
other(value) = strcol(3) eq "tracking" ? NaN : value
set ylabel "position [mm]"
plot ARG1 using 1:(tracking($4)) every ::1 with points pt 7 ps 0.2 lc rgb "#1f77b4" title "error while tracking", \
     ARG1 using 1:(other($4)) every ::1 with points pt 7 ps 0.4 lc rgb "#ff7f0e" title "converging or lost"
set ylabel "rotation [deg]"
plot ARG1 using 1:(tracking($5)) every ::1 with points pt 7 ps 0.2 lc rgb "#1f77b4", \
     ARG1 using 1:(other($5)) every ::1 with points pt 7 ps 0.4 lc rgb "#ff7f0e"
set ylabel "d_T [px]"
set yrange [0:6]
plot 5 lc rgb "#d62728" dt 2 title "lost above", ARG1 using 1:6 every ::1 with lines lc rgb "#2ca02c" title "backtracking, Eq. (13)"
set ylabel "d_R [rad]"
set xlabel "time [s]"
set yrange [0:0.2]
plot 0.15 lc rgb "#d62728" dt 2 title "lost above", ARG1 using 1:7 every ::1 with lines lc rgb "#2ca02c" title "backtracking, Eq. (14)"
unset multiplot
