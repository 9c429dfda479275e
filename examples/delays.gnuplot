# End-to-end delay and output rate over time: gnuplot -c delays.gnuplot delays.csv delays.png
set terminal pngcairo size 700,420 font "sans,9" background "#ffffff"
set output ARG2
set datafile separator ","
set key top right opaque
set grid back lc rgb "#dddddd"
set tics nomirror
set border 3
set lmargin 11
stats ARG1 using 1 every ::1 nooutput name "time"
set xrange [0:time_max]
set multiplot layout 2,1
set ylabel "delay of a pose [ms]"
set logscale y
set yrange [0.01:*]
set format y "%g"
plot ARG1 using 1:2 every ::1 with points pt 7 ps 0.2 lc rgb "#1f77b4" notitle, \
     NaN with points pt 7 ps 1 lc rgb "#1f77b4" title "from its event's time to its delivery", \
     2.06 lc rgb "#d62728" dt 2 title "mean of the paper: 2.06 ms"
unset logscale y
set yrange [0:*]
set ylabel "output rate [1000 poses/s]"
set xlabel "time since the start [s]"
bin_s = 0.02
plot ARG1 using (bin_s * (floor($1 / bin_s) + 0.5)):(0.001 / bin_s) every ::1 smooth frequency with lines lc rgb "#2ca02c" notitle
unset multiplot
